"""Mistakes in what a localizer is given end with one message before a step is trained; what is odd but legal works."""

import numpy as np
import pytest
from data.places.place_pictures import picture
from PIL import Image
from quick_runs import quick_runs  # noqa: F401
from support import quick_config, told_before_training
from tiny_office import office_arguments, office_cache

from sextant.chapters.localization.task import Localization
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.lifecycle.execute import execute, run_digest
from sextant.runs.directory import RunDirectory

COUNT = 30


def drive(folder, name, shift=0.0, first=0):
    """Pictures a metre apart along a line, those of both drives of the same places, with noise of their own."""
    (folder / name).mkdir(parents=True)
    rows = ["file,x,y,heading"]
    for k in range(COUNT):
        noise = np.random.default_rng(first + k).normal(scale=10, size=(16, 24, 3))
        pixels = (0.8 * picture(k).astype(float) + 20 + noise).clip(0, 255).astype(np.uint8)
        Image.fromarray(pixels).save(folder / name / f"{k:03d}.png")
        rows.append(f"{k:03d}.png,{k + shift},0,0")
    (folder / name / "poses.csv").write_text("\n".join(rows))
    (folder / name / "odometry.csv").write_text("\n".join(rows))


@pytest.fixture
def folder(tmp_path):
    """A map and a run, with poses and odometry."""
    drive(tmp_path / "mine", "map")
    drive(tmp_path / "mine", "run", shift=0.1, first=1000)
    return tmp_path / "mine"


@pytest.fixture(scope="session")
def cache():
    return office_cache()


def arguments(folder, *overrides):
    usual = (
        "dataset=pose_folder", f"dataset.folder={folder}", "dataset.odometry=odometry.csv", "dataset.height=16",
        "dataset.width=24", "dataset.channels=3", "task.starts=2", "task.horizon=15", "descriptor.dimensions=8",
        "filter.particles=100", "trainer.max_epochs=1",
    )  # fmt: skip
    given = {override.partition("=")[0] for override in overrides}
    kept = [each for each in usual if each.partition("=")[0] not in given]
    if "descriptor" in given:
        kept = [each for each in kept if not each.startswith("descriptor.")]
    root = folder.parent
    return ["task=localization", *kept, "task.replay=false", "task.save_map=false", "trainer.progress=false",
            "tracking=none", f"paths.outputs={root / 'out'}", f"paths.cache={root / 'cache'}", *overrides]  # fmt: skip


def run(chosen):
    """The results of a run."""
    return RunDirectory(execute(to_plain(compose(chosen))).directory).results()


@pytest.fixture
def told(monkeypatch, capsys):
    return lambda words: told_before_training(Localization, words, monkeypatch, capsys)


def change(folder, name, table, edit):
    path = folder / name / f"{table}.csv"
    path.write_text("\n".join(edit(path.read_text().splitlines())))


def replaced(old, new):
    return lambda lines: [line.replace(old, new) for line in lines]


# -- the map -----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_images_of_the_map_at_one_pose(folder, told):
    change(folder, "map", "poses", replaced("004.png,4.0", "004.png,3.0"))
    said = told(arguments(folder))
    assert "dataset.map: 1 of 30 images has the same pose as another" in said
    assert "004.png = 003.png" in said
    assert "dataset.skip_bad=true" in said


@pytest.mark.slow
def test_they_are_left_out_if_so_wished(folder):
    change(folder, "map", "poses", replaced("004.png,4.0", "004.png,3.0"))
    assert "left out 004.png = 003.png" in run(arguments(folder, "dataset.skip_bad=true"))["notes"]


@pytest.mark.parametrize("wrong", ["nan", "inf", "x"])
@pytest.mark.parametrize("name", ["map", "run"])
def test_poses_that_are_no_numbers(folder, told, name, wrong):
    change(folder, name, "poses", lambda lines: [*lines[:6], f"005.png,{wrong},0,0", *lines[7:]])
    said = told(arguments(folder))
    assert "poses.csv" in said
    assert wrong in said


def test_an_empty_map(folder, told):
    for path in (folder / "map").glob("*.png"):
        path.unlink()
    assert "map" in told(arguments(folder))


def test_no_poses(folder, told):
    (folder / "run" / "poses.csv").unlink()
    said = told(arguments(folder))
    assert "dataset.test.run" in said
    assert "has no poses, the file poses.csv" in said


def test_a_dataset_without_poses(told, tmp_path):
    said = told(["task=localization", "dataset=digits", f"paths.outputs={tmp_path}", "tracking=none"])
    assert "dataset=digits has no drives with poses" in said
    assert "office_walk" in said


def test_drives_that_are_nowhere_near_the_map(folder, told):
    change(folder, "run", "poses", replaced(",0,0", ",900,0"))
    said = told(arguments(folder))
    assert "no image of the validation drives is within 0.5 m and 10 degrees of a map image" in said
    assert "Check that map and drives are in the same frame" in said


# -- odometry ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_without_odometry_it_works_and_says_so(folder):
    found = run(arguments(folder, "dataset.odometry=null"))
    assert any("the motion between images is unknown" in note for note in found["notes"])
    assert found["metrics"]["test/success"] >= 0


def test_odometry_that_is_not_there(folder, told):
    (folder / "run" / "odometry.csv").unlink()
    assert "has no odometry, the file odometry.csv" in told(arguments(folder))


def timed(folder, name, stamps):
    """The same drive in TUM's format, with times in the names."""
    for k, stamp in enumerate(stamps):
        (folder / name / f"{k:03d}.png").rename(folder / name / f"{stamp:09.3f}.png")
    rows = [f"{stamp:.3f} {k} 0 0 0 0 0 1" for k, stamp in enumerate(stamps)]
    for table in ("poses", "odometry"):
        (folder / name / f"{table}.txt").write_text("\n".join(rows))


TUM = ("dataset.poses=tum", "dataset.odometry=odometry.txt", "dataset.ahead=x")


def test_time_gaps_in_a_drive(folder, told):
    timed(folder, "map", 1000.0 + np.arange(COUNT))
    timed(folder, "run", 2000.0 + np.arange(COUNT) + 60.0 * (np.arange(COUNT) > 12))
    said = told(arguments(folder, *TUM))
    assert "dataset.test.run" in said
    assert "dataset.max_gap_s" in said


def test_images_out_of_order(folder, told):
    timed(folder, "map", 1000.0 + np.arange(COUNT))
    stamps = 2000.0 + np.arange(COUNT)
    timed(folder, "run", stamps)
    (folder / "run" / "times.txt").write_text("\n".join(map(str, np.roll(stamps, 3))))
    (folder / "map" / "times.txt").write_text("\n".join(map(str, 1000.0 + np.arange(COUNT))))
    said = told(arguments(folder, *TUM, "dataset.times=times.txt"))
    assert "dataset.test.run" in said


# -- descriptors -------------------------------------------------------------------------------------------------------


def vectors(folder, widths):
    """Files of descriptors of the map, of what is for validation and of what is for the test."""
    counts = {"map": COUNT, "run/start": 8, "run": COUNT - 8}
    for name, count in counts.items():
        path = folder.parent / "vectors" / f"{name}.npy"
        path.parent.mkdir(parents=True, exist_ok=True)
        start = 8 if name == "run" else 0
        rows = np.random.default_rng(0).normal(size=(COUNT, 12))[start : start + count, : widths.get(name, 12)]
        np.save(path, rows.astype(np.float32))
    return "descriptor=files", f"descriptor.folder={folder.parent / 'vectors'}"


@pytest.mark.slow
def test_vectors_worked_out_elsewhere(folder):
    found = run(arguments(folder, *vectors(folder, {})))
    assert found["metrics"]["val/place_nll"] < found["metrics"]["val/place_nll_uniform"]


@pytest.mark.parametrize("other", ["run", "run/start", "map"])
def test_vectors_of_another_width_than_the_maps(folder, told, other):
    said = told(arguments(folder, *vectors(folder, {other: 9})))
    assert "9" in said
    assert "12" in said
    assert f"{other}.npy" in said
    assert "same descriptor" in said


@pytest.mark.parametrize("name", ["map", "run"])
def test_vectors_of_another_count(folder, told, name):
    chosen = vectors(folder, {})
    path = folder.parent / "vectors" / f"{name}.npy"
    np.save(path, np.load(path)[:-1])
    said = told(arguments(folder, *chosen))
    assert f"{name}.npy has shape" in said
    assert "one per image" in said


@pytest.mark.parametrize("name", ["map", "run"])
def test_vectors_that_are_not_finite(folder, told, name):
    chosen = vectors(folder, {})
    path = folder.parent / "vectors" / f"{name}.npy"
    rows = np.load(path)
    rows[3, 2] = np.nan
    np.save(path, rows)
    assert "1 of " in (said := told(arguments(folder, *chosen)))
    assert "the first is row 3" in said


def test_a_damaged_and_a_missing_file_of_vectors(folder, told):
    chosen = vectors(folder, {})
    path = folder.parent / "vectors" / "run.npy"
    path.write_bytes(path.read_bytes()[:40])
    assert "run.npy cannot be read" in told(arguments(folder, *chosen))
    path.unlink()
    assert "run.npy cannot be read" in told(arguments(folder, *chosen))
    assert "no .npy file in it" in told(arguments(folder, chosen[0], "descriptor.folder=/nowhere"))


def test_vectors_that_are_pickled_objects_are_not_unpickled(folder, told):
    chosen = vectors(folder, {})
    np.save(folder.parent / "vectors" / "run.npy", np.array([{}] * 22, object), allow_pickle=True)
    assert "run.npy cannot be read" in told(arguments(folder, *chosen))


def test_the_digest_follows_what_a_descriptor_is_and_not_where_it_lies(tmp_path):
    def digest(kind, place):
        key = {"run": "descriptor.run", "files": "descriptor.folder"}[kind]
        return run_digest(validate(to_plain(compose(["task=localization", f"descriptor={kind}", f"{key}={place}"]))))

    for place, content in (("here", b"weights"), ("there/deep", b"weights"), ("other", b"other weights")):
        folder = tmp_path / place
        (folder / "run1").mkdir(parents=True)
        (folder / "model.ckpt").write_bytes(content)
        np.save(folder / "map.npy", np.ones((4, 3), np.float32))
        np.save(folder / "run1" / "night.npy", np.full((4, 3), len(content), np.float32))
    for kind, file in (("run", "model.ckpt"), ("files", "")):
        here, there, other = (digest(kind, tmp_path / place / file) for place in ("here", "there/deep", "other"))
        assert here == there
        assert here != other


@pytest.mark.slow
def test_a_run_that_gives_no_descriptor(folder, told):
    other = execute(quick_config(folder.parent / "out", "tracking=none", "trainer.max_epochs=1")).directory
    said = told(arguments(folder, "descriptor=run", f"descriptor.run={other}"))
    assert "is a run of task=classification" in said
    assert "task=place_recognition" in said


def test_a_run_that_is_not_there(folder, told):
    assert "no run, run directory or checkpoint" in told(arguments(folder, "descriptor=run", "descriptor.run=gone"))


def test_more_dimensions_than_the_map_has_images_are_as_many_as_it_spans(folder, told):
    with pytest.raises(AssertionError, match="it was trained"):  # nothing is refused
        told(arguments(folder, "descriptor.dimensions=200"))


# -- filter and faults -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("override", "near"),
    [
        ("recovery=bayes_restrat", "recovery=bayes_restart"),
        ("observation=cached_lokal", "observation=cached_local"),
        ("fault=kidnapp", "fault=kidnap"),
        ("filter.resampling=sistematic", "systematic"),
        ("likelihood.forms=full", "likelihood.form"),
        ("filter.particle=10", "filter.particles"),
    ],
)
def test_the_nearest_name_is_offered(folder, told, override, near):
    said = told(arguments(folder, override))
    assert override.split("=")[0].split(".")[-1] in said
    assert near in said


@pytest.mark.parametrize("value", ["0", "-5", "2000000", "many"])
def test_a_number_of_particles_that_cannot_be(folder, told, value):
    assert f"filter.particles={value}" in told(arguments(folder, f"filter.particles={value}")).replace("'", "")


def test_a_laser_where_there_is_none(folder, told):
    said = told(arguments(folder, "observation=laser_field"))
    assert "dataset=pose_folder has no laser scans" in said
    assert "office_walk" in said


def test_a_season_that_the_dataset_has_not(cache, told, tmp_path):
    chosen = ("fault=wrong_season_map", "fault.condition=winter_snow")
    said = told(office_arguments(cache, tmp_path, *chosen))
    assert "fault.condition=winter_snow" in said
    assert "summer_noon" in said


@pytest.mark.slow
def test_one_particle_works(folder):
    found = run(arguments(folder, "filter.particles=1", "recovery=none"))
    assert 0 <= found["metrics"]["test/success"] <= 1


@pytest.mark.slow
def test_a_horizon_longer_than_the_drive_works_and_is_noted(folder):
    found = run(arguments(folder, "task.horizon=500"))
    assert any("task.horizon=500" in note and "run" in note for note in found["notes"])


def test_a_fault_beyond_the_run(folder, told):
    said = told(arguments(folder, "fault=blackout", "fault.length=500"))
    assert "fault.length=500 from frame 8 on: run has 15 frames" in said
    assert "at most" in said
