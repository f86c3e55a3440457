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
from sextant.cli.cosfire_detection.options import DetectionOptions
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
