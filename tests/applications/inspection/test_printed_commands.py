"""The commands that ``inspect`` prints, run as they are printed; a map of the user is filled in."""

import json
import shlex

import cv2
import numpy as np
import pytest
from applications.inspection.folders import FOLDERS, classes, panorama
from applications.walks.test_walking import shoot
from made_up_bags import Bags

from sextant import cli
from sextant.geometry import PerspectiveCamera
from sextant.lifecycle.checks import checked, preflight, require_possible
from sextant.registry import chapter_of
from sextant.tools.inspection import inspect
from sextant.worlds import Town, condition, drive, irregular_streets, random_walk

SIZE = (112, 84)
FEW = ["one camera", "classes", "two rides", "two trajectories", "known cameras", "names with UTM"]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """The user is in a folder of their own, beside that with their files."""
    (tmp_path / "files").mkdir()
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setenv("SEXTANT_OUTPUTS", str(tmp_path / "outputs"))


def run_all(folder, choose=lambda command: True, smaller=()):
    """Run the commands for a folder, ``smaller`` added, and return them; one that fails raises ``SystemExit``."""
    printed = [command for each in inspect(folder).suggestions for command in each.commands if choose(command)]
    for command in printed:
        program, verb, *words = shlex.split(command)
        assert program == "sextant"
        cli.run(verb, [*words, *smaller])
    return printed


TRAINED = [
    "classes", "classes of few", "classes with splits", "twelve classes", "photos of classes, minutes apart",
    "panoramas",
    *(name for name in FOLDERS if name.startswith(("drives", "rides")) and name != "drives 20 m apart"),
]  # fmt: skip


@pytest.mark.parametrize("name", TRAINED)
def test_trainings_that_are_printed_have_enough_images(name, tmp_path):
    FOLDERS[name][0](tmp_path / "files")
    suggested = [command for each in inspect(tmp_path / "files").suggestions for command in each.commands]
    trainings = [command for command in suggested if command.startswith("sextant train")]
    assert trainings
    for command in trainings:
        config = checked(preflight(shlex.split(command)[2:]))
        require_possible(config, chapter_of(config.task.name).source(config))


@pytest.mark.parametrize("images", [5, 6, 8, 11, 16, 25, 32, 33])
@pytest.mark.parametrize("count", [2, 3])
def test_few_images_of_classes_are_a_batch(count, images, tmp_path):
    classes(tmp_path / "files", count, images)
    (suggested,) = [each for each in inspect(tmp_path / "files").suggestions if each.task == "classify images"]
    config = checked(preflight(shlex.split(suggested.commands[0])[2:]))
    require_possible(config, chapter_of("classification").source(config))


@pytest.mark.parametrize("count", [3, 5, 15, 17])
def test_few_panoramas_are_a_batch(count, tmp_path):
    for number in range(count):
        panorama(tmp_path / "files" / f"{number}.png", number)
    (suggested,) = [each for each in inspect(tmp_path / "files").suggestions if "panoramas" in each.task]
    config = checked(preflight(shlex.split(suggested.commands[0])[2:]))
    require_possible(config, chapter_of("calibration").source(config))


@pytest.mark.slow
@pytest.mark.parametrize("name", FEW)
def test_commands_for_photos_places_and_trajectories_run(name, tmp_path, capsys):
    FOLDERS[name][0](tmp_path / "files")
    printed = run_all(tmp_path / "files")
    assert printed
    for command in printed:
        values = dict(word.split("=", 1) for word in shlex.split(command) if "=" in word)
        assert "output" not in values or any((tmp_path / "work" / values["output"]).rglob("*.json")), command


@pytest.mark.slow
def test_commands_for_drives_a_metre_apart_run_and_find_the_robot(tmp_path, capsys):
    """A map with images 1 m apart, a second drive, a third one without poses but with odometry, a video and a bag."""
    streets = irregular_streets(size_m=200, block_m=80, seed=3)
    town, way = Town(streets, seed=3), random_walk(streets, 150, seed=1)
    mapped, second = (drive(streets, way, seed=seed).sample_by_distance(1).poses for seed in (2, 5))
    files, camera, autumn = tmp_path / "files", PerspectiveCamera.from_vfov(1.0, *SIZE), condition("autumn_morning")
    shoot(files / "map", town, condition("summer_noon"), mapped[:50], camera)
    images = shoot(files / "second", town, autumn, second[10:40], camera)
    shoot(files / "third", town, autumn, second[10:22], camera)
    (files / "third" / "poses.csv").unlink()
    rows = [f"{k:03d}.png,{x},{y},{turn}" for k, (x, y, turn) in enumerate(second[10:22])]
    (files / "third" / "odometry.csv").write_text("\n".join(["file,x,y,theta", *rows]))
    video = cv2.VideoWriter(str(files / "walk.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10.0, SIZE)
    for image in images:
        video.write(np.ascontiguousarray(image[..., ::-1]))
    video.release()
    bags = Bags(2)
    bags.write(files, [("/camera", k + 1, bags.image(k + 1, image, "rgb8")) for k, image in enumerate(images[:12])])

    trained = run_all(files, lambda command: command.startswith("sextant train"))
    assert len(trained) == 1
    assert "dataset.protocol=town" in trained[0]
    (metrics,) = (tmp_path / "outputs").glob("runs/localization/*/metrics.json")
    rates = {name: value for name, value in json.loads(metrics.read_text())["metrics"].items() if "success" in name}
    print(rates)
    assert max(rates.values()) > 0

    walks = run_all(files, lambda command: command.startswith("sextant walk"), ["photos=6"])
    assert any(f"odometry={files}/third/odometry.csv" in command for command in walks)
    printed = [command for each in inspect(files).suggestions for command in each.commands if "map=<map>" in command]
    assert len(printed) == 2
    for command in printed:
        words = shlex.split(command.replace("<map>", str(next((tmp_path / "work" / "walk").rglob("map")))))
        cli.run(words[1], words[2:])
        (output,) = [word.removeprefix("output=") for word in words if word.startswith("output=")]
        assert (tmp_path / "work" / output / "poses.csv").is_file()
