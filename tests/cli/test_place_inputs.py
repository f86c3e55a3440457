"""Mistakes in folders of places end with one message before anything is trained; what is left out is counted."""

import numpy as np
import pytest
from data.places.place_pictures import write_pictures
from quick_runs import quick_runs  # noqa: F401
from support import told_before_training
from tiny_places import place_words

from sextant.chapters.places.task import PlaceRecognition
from sextant.cli import evaluate
from sextant.composing.compose import compose, to_plain
from sextant.console.console import reporting_mistakes
from sextant.lifecycle.checks import preflight
from sextant.lifecycle.execute import execute
from sextant.runs.directory import RunDirectory

SPLITS = ("train", "val", "test")
LIGHTS = ("day", "night")
COUNT = 6


@pytest.fixture
def folder(tmp_path):
    """Six places in each split, seen by day and by night."""
    root = tmp_path / "mine"
    for k, split in enumerate(SPLITS):
        for j, light in enumerate(LIGHTS):
            write_pictures(root / split / light, [f"{n}.png" for n in range(COUNT)], first=1000 * k + 100 * j)
    return root


def arguments(folder, *overrides):
    short = ("pooling.grid=null", "task.batch_places=3", "task.baselines=false", "task.whitening=null")
    root = folder.parent
    chosen = place_words(folder, root / "outputs", *short, "trainer.max_epochs=1", f"paths.cache={root / 'cache'}")
    given = {override.partition("=")[0] for override in overrides}
    return [*(each for each in chosen if each.partition("=")[0] not in given), *overrides]


def trained(folder, *overrides):
    """The results of a run."""
    outcome = execute(to_plain(compose(arguments(folder, *overrides))))
    return RunDirectory(outcome.directory).results()


@pytest.fixture
def told(folder, monkeypatch, capsys):
    def tell(*overrides):
        said = told_before_training(PlaceRecognition, arguments(folder, *overrides), monkeypatch, capsys)
        assert len(said.strip().splitlines()) > 1 or "must be" in said  # what to do
        return said

    return tell


def tables(folder, change=lambda rows: rows, header="file,x,y,heading"):
    """A table in every folder, places ten metres apart; that of test/night changed."""
    for split in SPLITS:
        for light in LIGHTS:
            rows = [f"{n}.png,{10 * n},0,90" for n in range(COUNT)]
            rows = change(rows) if (split, light) == ("test", "night") else rows
            (folder / split / light / "poses.csv").write_text("\n".join([header, *rows]) + "\n")


def utm_names(folder, heading=lambda n: "90"):
    """Poses in the names of all files; of test/night with headings of their own."""
    for split in SPLITS:
        for light in LIGHTS:
            for n in range(COUNT):
                angle = heading(n) if (split, light) == ("test", "night") else "90"
                path = folder / split / light / f"{n}.png"
                path.rename(path.with_name(f"@{10 * n}.0@100.0@32@U@@@@@{angle}@@@@@{n}@@.png"))


# -- by order ----------------------------------------------------------------------------------------------------------


def test_rides_of_different_lengths(folder, told):
    (folder / "test" / "night" / "2.png").unlink()
    said = told("dataset.places=order")
    assert "dataset.test: dataset.places=order treats the i-th images" in said
    assert "day: 6 images" in said
    assert "night: 5 images" in said
    assert "dataset.places=name" in said


# -- by a table --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda rows: [rows[0], "1.png,,0,90", *rows[2:]], "line 3: x='' of 1.png must be a finite number"),
        (lambda rows: [rows[0], "1.png,nan,0,90", *rows[2:]], "line 3: x='nan' of 1.png must be a finite number"),
        (lambda rows: [rows[0], "1.png,1,-inf,90", *rows[2:]], "line 3: y='-inf' of 1.png must be a finite number"),
        (lambda rows: [rows[0], "1.png,1,0,", *rows[2:]], "line 3: heading='' of 1.png must be a finite number"),
        (lambda rows: [*rows, rows[0]], "line 8: 0.png has a row already"),
        (lambda rows: rows[1:], "dataset.test.night: 1 of 6 images has no row in"),
        (lambda rows: [*rows, "9.png,1,0,90"], "has no image\n  9.png"),
    ],
    ids=["missing", "nan", "inf", "heading missing", "twice", "no row", "no file"],
)
def test_tables_with_mistakes(folder, told, change, expected):
    tables(folder, change)
    said = told("dataset.places=csv")
    assert expected in said
    assert str(folder / "test" / "night" / "poses.csv") in said


def test_no_table_at_all(folder, told):
    assert "has a table poses.csv" in told("dataset.places=csv")


def test_tables_without_headings_where_headings_count(folder, told):
    tables(folder)
    for path in folder.rglob("poses.csv"):
        path.write_text(path.read_text().replace(",heading", "").replace(",90", ""))
    for key, split in (("tolerance", "train"), ("test_tolerance", "val")):
        nulled = [] if split == "train" else ["task.tolerance.m.heading_deg=null"]
        said = told("dataset.places=csv", *nulled)
        assert f"task.{key}.m.heading_deg=40, but 12 of 12 {split} images have no heading\n  day/0.png" in said
        assert f"task.{key}.m.heading_deg=null" in said


# -- by names ----------------------------------------------------------------------------------------------------------


def test_names_that_tell_no_pose(folder, told):
    utm_names(folder)
    path = next((folder / "test" / "night").glob("@0.0@*"))
    path.rename(path.with_name("@east@100.0@.png"))
    assert "dataset.test.night: 1 of 6 names contains no pose\n  @east@100.0@.png" in told("dataset.places=utm")


@pytest.mark.slow
def test_headings_that_some_names_lack(folder, told):
    utm_names(folder, lambda n: "" if n == 4 else "90")
    said = told("dataset.places=utm")
    assert "task.test_tolerance.m.heading_deg=40, but 1 of 12 test images has no heading\n  night/@40.0@" in said
    keys = [f"task.{key}.m.heading_deg=null" for key in ("tolerance", "test_tolerance")]
    metrics = trained(folder, "dataset.places=utm", *keys)["metrics"]
    assert metrics["test/queries_5m_night_to_day"] == COUNT


# -- files -------------------------------------------------------------------------------------------------------------


def test_equal_files_within_a_split_and_across(folder, told):
    (folder / "test" / "night" / "3.png").write_bytes((folder / "test" / "day" / "1.png").read_bytes())
    said = told("dataset.places=order")
    assert "dataset.test: 1 file is a duplicate of another\n  test/day/1.png = test/night/3.png" in said
    (folder / "test" / "night" / "3.png").write_bytes((folder / "train" / "day" / "1.png").read_bytes())
    assert "  train/day/1.png = test/night/3.png" in told("dataset.places=order")
    (folder / "test" / "night" / "3.png").unlink()
    (folder / "test" / "night" / "4.jpg").write_bytes((folder / "test" / "night" / "4.png").read_bytes())
    assert "two frames of the same name: 4.jpg and 4.png" in told("dataset.places=name")


@pytest.mark.parametrize("split", SPLITS)
def test_a_corrupt_frame(folder, told, split):
    (folder / split / "night" / "3.png").write_bytes(b"no image")
    said = told("dataset.places=order")
    assert f"{split} images of dataset=place_folders: 1 of 12 cannot be read\n  night/3.png cannot be decoded" in said
    assert "dataset.skip_bad=true" in said


@pytest.mark.slow
def test_corrupt_frames_that_are_left_out_are_in_the_record(folder):
    for split in SPLITS:
        (folder / split / "night" / "3.png").write_bytes(f"no image of {split}".encode())
    found = trained(folder, "dataset.places=order", "dataset.skip_bad=true")
    assert {split: len(names) for split, names in found["skipped"].items()} == dict.fromkeys(SPLITS, 1)
    assert found["skipped"]["train"][0].startswith("night/3.png cannot be decoded")
    assert found["metrics"]["test/queries_pm0f_night_to_day"] == COUNT - 1


# -- conditions and splits ---------------------------------------------------------------------------------------------


def test_an_empty_condition(folder, told):
    for path in (folder / "test" / "night").iterdir():
        path.unlink()
    said = told("dataset.places=order")
    assert f"dataset.test.night={folder / 'test' / 'night'} holds no images" in said


def test_a_condition_without_a_readable_image(folder, told):
    for path in (folder / "test" / "night").iterdir():
        path.write_text(f"no image, {path.name}")
    assert "dataset.test.night: none of its images" in told("dataset.places=order", "dataset.skip_bad=true")


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        (["dataset.test={day: test/day, fog: test/fog}"], "/test/fog does not exist"),
        (["task.test_conditions=[day,fog]"], "task.test_conditions=['day', 'fog']: the test split of"),
        (["task.train_conditions=[day,fog]"], "task.train_conditions=['day', 'fog']: the train split of"),
        (["task.test_conditions=[day,day]"], "task.test_conditions=['day', 'day'] must name conditions, each once"),
        (["task.test_conditions=[day]"], "the test split has one condition, day"),
        (["dataset.val={day: val/day}"], "the val split has one condition, day"),
        (["dataset.train=null"], "dataset.train is null"),
        (["dataset.val=null"], "dataset.val is null"),
        (
            ["dataset.val={day: train/day, night: val/night}"],
            "dataset.train.day=train/day and dataset.val.day=train/day",
        ),
        (["task.batch_places=7"], "task.batch_places=7, but the training split has 6 places"),
        (
            ["task.tolerance.frames={positive: 1, negative: 1, heading_deg: null}"],
            "task.tolerance.frames.negative: positive=1 must be below negative=1",
        ),
        (
            ["task.test_tolerance.frames={positive: 0, negative: 0, heading_deg: null}"],
            "task.test_tolerance.frames.negative=0",
        ),
        (["dataset.folder=/nowhere"], "dataset.folder: no such folder. Looked for"),
        (["dataset.folder=null"], "dataset.folder=None: must be"),
        (["dataset.places=imu"], "dataset.places='imu': must be 'csv', 'utm', 'gps', 'order' or 'name'"),
        (["dataset.places=gps"], "dataset.train: 12 of 12 images have no GPS position in EXIF"),
    ],
)
def test_choices_with_mistakes(told, overrides, expected):
    assert expected in told("dataset.places=order", *overrides)


def test_a_folder_must_be_named(capsys):
    with pytest.raises(SystemExit), reporting_mistakes():
        preflight(["task=place_recognition", "dataset=place_folders"])
    assert "dataset.folder has no default" in capsys.readouterr().err


# -- queries without a positive ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_queries_without_a_positive_are_counted(folder):
    tables(folder, lambda rows: ["0.png,9000,0,90", "1.png,8000,0,90", *rows[2:]])
    metrics = trained(folder, "dataset.places=csv")["metrics"]
    name = "5m_40deg_night_to_day"
    assert metrics[f"test/queries_{name}"] == COUNT
    assert metrics[f"test/queries_without_positive_{name}"] == 2
    over_all, matchable = metrics[f"test/R_at_1_{name}"], metrics[f"test/R_at_1_matchable_{name}"]
    assert over_all == pytest.approx(matchable * (COUNT - 2) / COUNT)
    assert np.isfinite(metrics[f"test/place_nll_{name}"])


def test_a_split_of_which_no_query_has_a_positive(folder, told):
    tables(folder, lambda rows: [f"{n}.png,{9000 + n},0,90" for n in range(COUNT)])
    said = told("dataset.places=csv")
    assert "none of 6 test images of night has its place among the images of day, within 5m_40deg" in said
    assert "task.test_tolerance.m.positive" in said


# -- testing a trained model elsewhere ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_two_folders_are_a_test_with_baselines_and_a_tolerance_of_its_own(folder, capsys):
    outcome = execute(to_plain(compose(arguments(folder, "dataset.places=order"))))
    outputs = folder.parent / "outputs"
    again = [f"run={outcome.directory}", "tracking=none", f"paths.outputs={outputs}"]
    two = ["dataset=place_folders", f"dataset.folder={folder}", "dataset.test={map: test/day, asked: test/night}"]
    two += ["dataset.places=order", "dataset.height=16", "dataset.width=24", "task.baselines=true"]
    shown = {}
    for within in (0, 2):
        capsys.readouterr()
        tolerance = [f"task.test_tolerance.frames.{end}" for end in (f"positive={within}", "negative=9")]
        evaluate.main([*again, *two, *tolerance])
        printed = " ".join(capsys.readouterr().out.split())
        assert all(method in printed for method in ("patch-normalised", "whitened PCA", "HOG", "network"))
        tested = [RunDirectory(path).results() for path in (outputs / "runs" / "evaluation").iterdir()]
        (results,) = [one for one in tested if one and f"test/R_at_1_pm{within}f_asked_to_map" in one["metrics"]]
        shown[within] = {row["method"]: float(row["R@1"]) for row in results["table"]}
        assert set(results["baselines_left_out"]["asked"]) == {"LDA", "CCA"}
        assert not any("place_nll" in name for name in results["metrics"])  # no split to fit a temperature on
    assert all(shown[2][method] >= shown[0][method] for method in shown[0])
    assert shown[2] != shown[0]


@pytest.mark.slow
def test_evaluation_says_which_split_it_needs(folder, capsys):
    outcome = execute(to_plain(compose(arguments(folder, "dataset.places=order"))))
    again = [f"run={outcome.directory}", "tracking=none", f"paths.outputs={folder.parent / 'outputs'}"]
    for overrides, expected in (
        (["dataset.width=32"], "images of 3x16x32"),
        (["dataset.test={day: test/day}"], "the test split has one condition"),
    ):
        with pytest.raises(SystemExit), reporting_mistakes():
            evaluate.main([*again, *overrides])
        assert expected in capsys.readouterr().err
