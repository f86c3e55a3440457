"""The commands that programs print can be pasted: whatever the user typed, they compose.

Boundaries of what a user may type: nothing; another task; the group or key that the sweep hint varies, with one of its
two values, with a third, and with keys that only that option has; a seed; values with spaces, lists and quotes; a data
set of one's own; config files of one's own with parts outside Sextant; another output folder; another store.
"""

import re
import shlex
import sys
from itertools import product

import docs_commands
import numpy as np
import pytest
from calibration_toy import panorama_files
from docs_commands import Command, check
from PIL import Image
from quick_runs import quick_runs  # noqa: F401
from support import QUICK as QUICK_CLASSIFIER
from tiny_digits import PLAIN
from tiny_office import OFFICE
from tiny_office import QUICK as QUICK_LOCALIZER
from tiny_places import ride

from sextant import cli
from sextant.cli.next_commands import next_commands
from sextant.composing.compose import compose, to_plain
from sextant.composing.config_files import own_configs, without_folder
from sextant.errors import UserError, command
from sextant.lifecycle.checks import checked, preflight
from sextant.runs.directory import RunDirectory

ROBOT = ["task=localization", *OFFICE, *(each for each in QUICK_LOCALIZER if not re.search("horizon|save_map", each))]
TASKS = ["classification", "calibration", "place_recognition", "localization", "cosfire"]
TYPED = {
    "nothing": [],
    **{task: [f"task={task}"] for task in TASKS},
    **{f"{task}, fast": [f"task={task}", "trainer=fast"] for task in TASKS},
    "the control of the hint": ["inhibition=none"],
    "its treatment": ["inhibition=push_pull", "trainer=fast"],
    "a third option": ["inhibition=twin"],
    "a third option with a key of its own": ["inhibition=push_pull", "inhibition.scale=3"],
    "a key of the other option": ["task=place_recognition", "loss=info_nce", "loss.temperature=0.2"],
    "another loss": ["task=calibration", "experiment=calibration_small", "loss=l2_range"],
    "a key that the hint varies": ["task=cosfire", "task.filters_per_class=7"],
    "a seed": ["seed=3", "trainer=fast"],
    "a list": ["task=localization", "dataset.size_m=[14, 12]", "dataset.metres=[40, 8, 16]", "task.starts=3"],
    "keys": ["task=place_recognition", "dataset.frames={train: 160, val: 60, test: 80}"],
    "one's own images": ["dataset=image_folder", "dataset.folder=my photos", "backbone=lenet_a"],
    "one's own places": ["task=place_recognition", "dataset=place_folders", "dataset.folder='my places'"],
    "another folder": ["paths.outputs=/tmp/my outputs"],
    "no store": ["tracking=none"],
    "a server": ["tracking=server", "tracking.uri=http://127.0.0.1:5000"],
    "a device": ["trainer.devices=2", "trainer=ddp"],
    "a part of one's own": ["backbone=mine", "--config-dir={}"],
}
#: half a second each; the others are for the slow tests
QUICK = ("nothing", "a key of the other option", "one's own images", "another folder", "a part of one's own")


def quick(cases, names):
    """The cases as parameters, of which only those with these names are run by the suite without its slow tests."""
    return [pytest.param(case, id=n, marks=[] if n in names else pytest.mark.slow) for n, case in cases.items()]


@pytest.fixture
def own(tmp_path):
    folder = tmp_path / "my configs"
    (folder / "backbone").mkdir(parents=True)
    (folder / "backbone" / "mine.yaml").write_text("_target_: collections.Counter\n")
    return folder


@pytest.mark.parametrize("typed", quick(TYPED, QUICK))
def test_what_follows_a_run_can_be_pasted(typed, own, tmp_path, monkeypatch):
    typed, folder = without_folder([word.format(own) if word.startswith("--") else word for word in typed])
    with own_configs(folder):
        try:
            config = checked(to_plain(compose(typed)))
        except UserError as error:
            pytest.fail(f"the example is wrong itself: {error}")
        outputs = tmp_path / "outputs"
        found = next_commands(config, RunDirectory(outputs / "runs" / "task" / "a-s0"), "outputs/runs/task/a-s0", typed)
        monkeypatch.setitem(docs_commands.MODELS, "here", tuple(typed))
        for text in found.values():
            check(Command("here", text))
    words = shlex.split(found["sweep"].replace("<", "").replace(">", ""))
    kept = [word for word in typed if not word.startswith(("seed=", "inhibition=", "loss=", "task.filters_per_class="))]
    assert set(kept) <= set(words)
    assert "seed=0,1,2" in words
    assert (folder is not None) == any(word.startswith("--config-dir=") for word in words)
    for verb in ("evaluate", "predict"):
        assert ("trust=true" in found[verb]) == (folder is not None)
    assert f"outputs={outputs}" in found["dashboard"]


@pytest.mark.parametrize("typed", [["task.save_map=false"], ["observation=laser_field"], ["filter=interpolated"]])
def test_no_prediction_follows_a_run_that_keeps_no_map(typed, tmp_path):
    typed = ["task=localization", *typed]
    config = checked(to_plain(compose(typed)))
    directory = RunDirectory(tmp_path / "runs" / "localization" / "a-s0")
    assert set(next_commands(config, directory, "a-s0", typed)) == {"evaluate", "sweep", "dashboard"}


def test_an_option_of_ones_own_is_compared_with_the_default(tmp_path):
    config = checked(to_plain(compose(["inhibition=twin"])))
    directory = RunDirectory(tmp_path / "runs" / "classification" / "a-s0")
    sweep = next_commands(config, directory, "a-s0", ["inhibition=twin"])["sweep"]
    assert sweep == "sextant train -m seed=0,1,2 inhibition=none,twin"


@pytest.mark.parametrize(
    "overrides",
    quick(
        {
            "a sweep": ["sweep=demo", "trainer.progress=false"],
            "a quoted folder": ["seed=0,1", "dataset=image_folder", "dataset.folder='my photos'"],
            "a launcher": ["launcher=joblib", "task=localization", "dataset.size_m=[14, 12]"],
            "several rates": ["optimizer.lr=0.1,0.2", "backbone=lenet_b"],
        },
        ["a quoted folder"],
    ),
)
def test_a_remedy_can_be_pasted(overrides):
    with pytest.raises(UserError) as found:
        preflight(overrides)
    text = re.search(r"sextant train -m .*", found.value.fix)[0]
    assert shlex.split(text)[3:] == overrides
    check(Command("here", text))


def test_a_command_is_quoted_for_a_shell_except_its_placeholders():
    words = ["train", "a=b c", "d=<folder of photos>", "e='f'", "g=$(ls)"]
    line = command(*words, outputs="/x y")
    assert "d=<folder of photos>" in line
    assert shlex.split(line.replace("d=<folder of photos>", "'d=<folder of photos>'"))[1:] == [*words, "outputs=/x y"]


TINY = ("trainer.max_epochs=1", "trainer.workers=0", "trainer.progress=false", "tracking=none")
PANORAMAS = (
    "task=calibration", "dataset=panorama_folder", "dataset.folder=panoramas", "dataset.height=64",
    "dataset.fractions={train: 0.4, val: 0.4, test: 0.2}", "task.width=32", "task.height=24",
    "task.crops_per_panorama={train: 8, val: 8, test: 3}", "task.geometric_baselines=false", "trainer.batch_size=8",
    "backbone=strided_cnn", "backbone.widths=[8,8]", *TINY,
)  # fmt: skip
PLACES = (
    "task=place_recognition", "dataset=place_folders", "dataset.folder=places", "dataset.places=name",
    *(f"dataset.{split}={{day: {split}/day, night: {split}/night}}" for split in ("train", "val", "test")),
    "dataset.height=32", "dataset.width=48", "pooling.grid=null", "task.dimension=16", "task.batch_places=5",
    "task.whitening=null", "backbone.widths=[8,8]", *TINY,
)  # fmt: skip
#: what is typed, what each command then ends with, and the user's own for its placeholders
RUNS = {
    "a classifier": (
        ["trainer=fast", *QUICK_CLASSIFIER, "trainer.max_epochs=1", "tracking=none"], ("Result", "3 images"), {}
    ),
    "a robot in the office of the tutorial": ([*ROBOT, "task.save_map=true"], ("On the test split", "3 images"), {}),
    "a camera": (list(PANORAMAS), ("On the test split", "3 photos calibrated"), {}),
    "places": (
        list(PLACES), ("On the test split", "6 queries looked up"),
        {"<folder of reference/ and query/>": "asked", "map=<folder>": "map=asked/reference",
         "queries=<folder>": "queries=asked/query"},
    ),
    "COSFIRE filters": (
        ["task=cosfire", *PLAIN, "trainer.progress=false", "tracking=none"], ("On the test split", "3 images"), {}
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", RUNS)
def test_what_is_printed_after_a_run_runs_as_it_is_printed(name, tmp_path, monkeypatch, capsys):
    typed, (tested, answered), placeholders = RUNS[name]
    monkeypatch.setenv("SEXTANT_OUTPUTS", str(tmp_path / "outputs"))
    monkeypatch.chdir(tmp_path)
    for k in range(3):
        (tmp_path / "photos").mkdir(exist_ok=True)
        picture = np.random.default_rng(k).integers(0, 256, (32, 48, 3), np.uint8)
        Image.fromarray(picture).save(tmp_path / "photos" / f"{k}.png")
    (tmp_path / "odometry.csv").write_text("x,y,theta\n" + "".join(f"{k / 10},0,0\n" for k in range(3)))
    if name == "a camera":
        panorama_files(tmp_path / "panoramas")
    if name == "places":
        for first, (split, light) in enumerate(product(("train", "val", "test"), ("day", "night"))):
            places = range(1000 * (first // 2), 1000 * (first // 2) + (6 if split == "test" else 12))
            ride(tmp_path / "places" / split / light, places, light == "night")
        for name_of in ("reference", "query"):
            ride(tmp_path / "asked" / name_of, range(6), name_of == "query")
            rows = "\n".join(f"{k:03d}.png,{100 * k},0,0" for k in range(6))
            (tmp_path / "asked" / name_of / "poses.csv").write_text(f"file,x,y,heading\n{rows}\n")
    monkeypatch.setattr(sys, "argv", ["train.py"])
    cli.run("train", typed)
    lines = re.findall(r"^(evaluate|predict|sweep) +sextant (.*)$", capsys.readouterr().out, re.MULTILINE)
    assert [what for what, _ in lines] == ["evaluate", *(["predict"] if answered else []), "sweep"]
    own = {
        **placeholders, "output=<folder>": "output=found", "<folder of photos>": "photos", "<table>": "odometry.csv",
        "<panoramas>": "panoramas", "<folder>": "photos",
    }  # fmt: skip
    printed = {"evaluate": tested, "predict": answered, "sweep": "6 planned, "}
    if name != "a classifier":  # whose sweep is run whole; of the others, the arm of another option
        own["seed=0,1,2"] = "seed=0"
        printed["sweep"] = "2 planned, "
    for what, line in lines:
        text = line
        for placeholder, path in own.items():
            text = text.replace(placeholder, path)
        verb, *words = shlex.split(text)
        cli.run(verb, words)
        assert printed[what] in capsys.readouterr().out
    if "task=localization" in typed:  # what the pages name, on the whole drives of the tutorial
        run = next(word for word in shlex.split(lines[0][1]) if word.startswith("run="))
        cli.run("evaluate", [run, "fault=blackout"])
