"""Outputs that are read as inputs, and shares.

Boundaries of the first kind: the input folder itself, by its name, through ``.`` and ``..``, a relative path, a link to
it, a link above it; a folder within a map or queries, existing or not; the folder around the inputs, a folder beside
them, and one whose name begins alike, which are fine; a file in the way.
"""

import math
from pathlib import Path

import pytest
from PIL import Image

from sextant import cli
from sextant.applications.arguments import check_apart, check_share
from sextant.chapters.cosfire.options import DetectionOptions
from sextant.errors import UserError


@pytest.fixture
def rides(tmp_path, monkeypatch):
    for name in ("map/inner", "queries", "input", "other"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("map/a.png", "map/inner/b.png", "queries/a.png", "input/a.png", "input/c.png"):
        Image.new("RGB", (64, 48)).save(tmp_path / name)
    (tmp_path / "link").symlink_to("map")
    (tmp_path / "above").symlink_to(tmp_path)
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "dangling").symlink_to("nowhere")
    monkeypatch.chdir(tmp_path / "other")
    return tmp_path


BAD = {
    "the map": ("{}/map", "is map="),
    "the queries": ("{}/queries", "is queries="),
    "the input": ("{}/input", "is input="),
    "with a dot": ("{}/map/.", "is map="),
    "up and down": ("{}/queries/../map", "is map="),
    "relative": ("../map", "is map="),
    "a link to it": ("{}/link", "is map="),
    "through a link above it": ("{}/above/map", "is map="),
    "a slash at the end": ("{}/map/", "is map="),
    "a new folder in the map": ("{}/map/found", "lies in map="),
    "a new folder in a new folder": ("{}/map/x/y/found", "lies in map="),
    "a folder of its photos": ("{}/map/inner", "lies in map="),
    "in the map by a link": ("{}/link/found", "lies in map="),
    "in the map, relative": ("../map/found", "lies in map="),
    "in the queries": ("{}/queries/found", "lies in queries="),
    "a file": ("{}/file", "it is a file"),
    "below a file": ("{}/file/found", "file is a file"),
    "a link to nothing": ("{}/dangling", "it is a file"),
}
GOOD = ["{}", "{}/found", "{}/map_found", "{}/maps", "{}/other", ".", "found", "{}/input/found", "{}/new/deep/er"]


@pytest.mark.parametrize("name", BAD)
def test_results_go_to_no_folder_that_is_read(rides, name):

    output, says = BAD[name]
    with pytest.raises(UserError, match=says) as caught:
        check_apart(
            Path(output.format(rides)), map=rides / "map", queries=str(rides / "queries"), input=rides / "input"
        )
    assert "output=" in caught.value.fix


@pytest.mark.parametrize("output", GOOD)
def test_elsewhere_they_may(rides, output):

    check_apart(Path(output.format(rides)), map=rides / "map", queries=rides / "queries", input=rides / "input")


def test_what_a_fix_names_is_fine(rides):
    for output, _ in BAD.values():
        with pytest.raises(UserError) as caught:
            check_apart(Path(output.format(rides)), map=rides / "map", queries=rides / "queries", input=rides / "input")
        if "_found" in caught.value.fix:
            named = caught.value.fix.partition("output=")[2]
            check_apart(Path(named), map=rides / "map", queries=rides / "queries", input=rides / "input")


@pytest.mark.parametrize(
    "words",
    [
        "predict run=zoo:places map={map} queries={queries} output={map}",
        "predict run=zoo:places map={map} queries={queries} output={map}/found",
        "predict run=zoo:places map={map} queries={queries} output={queries}",
        "predict input={input} output={input}",
        "predict input={input}/a.png output={input}",
        "predict input={input}/*.png output={input}",
        "predict run=zoo:digits input={input} output={input}",
        "predict task=cosfire prototype={input}/a.png input={input} output={input}",
        "predict task=cosfire prototype={map}/a.png input={input} output={map}",
        "predict run=zoo:office input={input} output={input}",
        "localize map=zoo:office input={input} output={input}",
        "walk input={input} map={map} output={input}",
        "walk input={input} map={map} output={map}",
        "walk input={input} map={map} output={map}/walk",
        "benchmark calibration folder={input} output={input}",
        "benchmark calibration folder={input} output={input}/found",
    ],
)
def test_commands_refuse_it_before_they_begin(rides, words, capsys):
    before = sorted(rides.rglob("*"))
    verb, *given = words.format(map=rides / "map", queries=rides / "queries", input=rides / "input").split()
    with pytest.raises(SystemExit, match="2"):
        cli.run(verb, given)
    said = capsys.readouterr().err
    assert "Error: output=" in said
    assert "of its own: output=" in said.replace("\n", " ")
    assert sorted(rides.rglob("*")) == before


@pytest.mark.parametrize(
    "words",
    [
        "inspect {map} json={map}/transforms.json",
        "inspect {map}/transforms.json json={map}/transforms.json",
        "inspect {map}/transforms.json json={link}/transforms.json",
        "inspect {map} json={map}/a.json",
        "inspect {map} json={map}/a.png",
        "inspect {map} json={map}",
        "trajectory {map}/poses.json {map}/transforms.json json={map}/transforms.json",
        "trajectory {map}/poses.json {map}/transforms.json json={link}/poses.json",
        "trajectory {map}/poses.png {map}/poses.json figure={link}/poses.png",
        "trajectory {map}/poses.json {map}/poses.json figure={map}/poses.json",
        "trajectory {map}/poses.json {map}/poses.json figure={map}/folder.png",
        "train task=place_recognition dataset=place_folders {places} paths.outputs={map}",
        "train task=place_recognition dataset=place_folders {places} paths.outputs={map}/runs",
        "train task=place_recognition dataset=place_folders {places} paths.outputs={link}/runs",
        "train task=place_recognition dataset=place_folders {places} paths.cache={queries}/cache",
        "train task=localization dataset=pose_folder {drives} paths.outputs={queries}",
        "train task=localization dataset=pose_folder {drives} paths.cache={map}/x",
        "train task=calibration dataset=panorama_folder dataset.folder={map} paths.outputs={map}",
        "train task=calibration dataset=panorama_folder dataset.folder={map} paths.outputs={map}/runs",
        "evaluate run=zoo:places dataset=place_folders {places} paths.outputs={map}/runs",
    ],
)
def test_files_and_runs_are_kept_apart_too(rides, words, capsys):
    for name in ("transforms.json", "a.json", "poses.json", "poses.png"):
        (rides / "map" / name).write_text("[1]")
    (rides / "map" / "folder.png").mkdir()
    before = {path: path.is_file() and path.read_bytes() for path in rides.rglob("*")}
    verb, *given = words.format(
        map=rides / "map",
        queries=rides / "queries",
        link=rides / "link",
        places=f"dataset.folder={rides} dataset.test={{reference:map,query:queries}}",
        drives=f"dataset.folder={rides} dataset.map=map dataset.test={{run:queries}} dataset.poses=csv",
    ).split()
    with pytest.raises(SystemExit, match="2"):
        cli.run(verb, given)
    said = " ".join(capsys.readouterr().err.split())
    assert "a file of its own" in said or "it would be replaced" in said or "a folder of its own: paths." in said
    assert {path: path.is_file() and path.read_bytes() for path in rides.rglob("*")} == before


def test_an_export_does_not_go_among_the_files_of_its_run(tmp_path, monkeypatch):
    from sextant.lifecycle import exporting
    from sextant.runs.directory import RunDirectory
    from sextant.runs.resolve import FoundRun

    run = tmp_path / "runs" / "cosfire" / "1a2b3c4d-s0"
    run.mkdir(parents=True)
    monkeypatch.setattr(exporting, "resolve_run", lambda *_: FoundRun(run / "last.ckpt", RunDirectory(run)))
    monkeypatch.setattr(exporting, "read_trained", lambda *_: {exporting.KEY: {"task": "cosfire"}})
    monkeypatch.setattr(exporting, "exportable", lambda *_, **__: None)
    for output in (run, run / "exported"):
        with pytest.raises(UserError, match=r"run=.*"):
            exporting.export_run("1a2b3c4d-s0", output=output)


def test_what_inspect_wrote_may_be_written_again(rides, capsys):
    words = [str(rides / "queries"), f"json={rides / 'queries' / 'inspection.json'}"]
    cli.run("inspect", words)
    first = (rides / "queries" / "inspection.json").read_text()
    cli.run("inspect", words)
    assert '"images": 1' in first
    assert '"images": 1' in (rides / "queries" / "inspection.json").read_text()
    print(capsys.readouterr().out)


@pytest.mark.parametrize("value", [0.001, 0.5, 1, 1.0])
def test_shares(value):
    check_share("threshold", value, "threshold=0.7")
    assert DetectionOptions.of({"threshold": str(value)}).threshold == value


@pytest.mark.parametrize("value", [0, -0.1, 1.0001, 5, 70, math.nan, math.inf, True, "0.5x"])
def test_what_is_no_share(value):
    with pytest.raises(UserError, match=r"threshold=.* must be a share above 0 and at most 1"):
        check_share("threshold", value, "threshold=0.7")
    with pytest.raises(UserError, match=r"threshold=.* must be a number"):
        DetectionOptions.of({"threshold": str(value)})
