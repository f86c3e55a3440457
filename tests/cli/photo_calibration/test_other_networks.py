"""``predict.py network=...``: photos calibrated by a network of others, of random weights in its authors' layout."""

import json

import pytest
import torch
from cli.photo_calibration.fakes import photo
from models.published_cameras import FILES

from sextant.cli import predict
from sextant.errors import UserError


@pytest.fixture
def theirs(tmp_path):
    torch.manual_seed(0)
    torch.save(FILES["anycalib"](), tmp_path / "theirs.pt")
    return tmp_path / "theirs.pt"


def test_photos_are_calibrated_and_the_network_is_named(theirs, tmp_path, capsys):
    photo(tmp_path / "photos" / "a.png", size=(160, 120))
    output = tmp_path / "out"
    predict.main([f"network=anycalib:{theirs}", f"input={tmp_path / 'photos'}", f"output={output}", "method=network"])
    said = capsys.readouterr().out
    assert "AnyCalib, " in said
    assert "not supplied by Sextant; spreads as the network gives them" in said
    (row,) = json.loads((output / "calibrations.json").read_text())["photos"]
    assert row["intervals_by"] == "the network's spreads, Student's t"
    assert row["confidence"]["verdict"] == "not trustworthy"  # rays alone say nothing of tilt and roll


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["network=anycalib:{file}", "run=zoo:calibration"], "run= does not go with network="),
        (["network=geocalib:{file}"], "is not a file of GeoCalib: its arrays are those of AnyCalib"),
        (["network=anycalib"], r"network=anycalib must be geocalib:<file> or anycalib:<file>"),
        (["scale=x.json"], r"scale=x\.json is for a network of others"),
        (["network=anycalib:{file}", "scale={file}"], "is not a file of the scales of a network"),
    ],
)
def test_mistakes_are_told(given, says, theirs, tmp_path):
    photo(tmp_path / "photos" / "a.png")
    words = [each.format(file=theirs) for each in given]
    with pytest.raises(UserError, match=says):
        predict.main([*words, f"input={tmp_path / 'photos'}", f"output={tmp_path / 'out'}"])


def test_the_input_is_needed(theirs):
    with pytest.raises(UserError, match="input= is missing"):
        predict.main([f"network=anycalib:{theirs}"])
