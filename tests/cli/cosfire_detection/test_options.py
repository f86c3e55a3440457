"""What may be chosen, and what is told of mistakes before anything is read."""

import re

import pytest
from cli.cosfire_detection.drawn import drawn

from sextant.chapters.cosfire.detector_options import PHOTO, PRESET_NAMES
from sextant.chapters.cosfire.options import DetectionOptions
from sextant.cli import predict
from sextant.errors import UserError
from sextant.layers.cosfire import PRESETS


def test_every_preset_that_detects_can_be_named():
    assert (PHOTO, *(name for name in PRESETS if not name.startswith("vessel"))) == PRESET_NAMES


def test_values_are_read():
    given = {
        "point": "12.5,7", "rotations": "8", "scales": "0.5,1,2", "reflection": "true", "threshold": "0.4",
        "min_distance": "9", "max_detections": "3", "longest": "640", "preset": "symbol",
    }  # fmt: skip
    assert DetectionOptions.of(given) == DetectionOptions(
        point=(12.5, 7.0), preset="symbol", rotations=8, scales=(0.5, 1.0, 2.0), reflection=True, threshold=0.4,
        min_distance=9.0, max_detections=3, longest=640,
    )  # fmt: skip
    assert DetectionOptions.of({}) == DetectionOptions()
    assert DetectionOptions.of({"reflection": "false"}).reflection is False


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"preset": "digits"}, "preset=digits must be one of photo, bifurcation"),
        ({"preset": "digit", "run": "x"}, "preset= and run= exclude each other"),
        ({"layer": "conv2"}, "needs the network of run=, which is missing"),
        ({"point": "12"}, "point=12 must be two numbers"),
        ({"point": "a,b"}, "point=a,b must be two numbers"),
        ({"point": "nan,1"}, "point=nan,1 must be two numbers"),
        ({"scales": "0,1"}, "scales=0,1 must be numbers above 0"),
        ({"scales": ""}, "scales= must be numbers"),
        ({"rotations": "0"}, "rotations=0 must be a whole number from 1 to 360"),
        ({"rotations": "1.5"}, "rotations=1.5 must be a whole number"),
        ({"reflection": "yes"}, "reflection=yes must be true or false"),
        ({"threshold": "0"}, "threshold=0 must be a number above 0"),
        ({"threshold": "0.2,0.3"}, "must be a number above 0"),
        ({"min_distance": "-3"}, "min_distance=-3 must be a number above 0"),
        ({"max_detections": "0"}, "max_detections=0 must be a whole number from 1 up"),
        ({"longest": "8"}, "longest=8 must be a whole number from 16 up"),
    ],
)
def test_mistakes_are_told(given, says):
    with pytest.raises(UserError, match=re.escape(says)):
        DetectionOptions.of(given)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["task=classification", "input={image}"], "task=classification: only task=cosfire predicts without a run"),
        (["prototype={image}", "input={image}"], "prototype= belongs to task=cosfire"),
        (["task=cosfire", "input={image}", "output={out}"], "prototype= is missing"),
        (["task=cosfire", "prototype={image}", "output={out}"], "input= is missing"),
        (["task=cosfire", "prototype={image}", "input={image}"], "output= is missing"),
        (["{all}", "camera=one"], "camera= does not go with task=cosfire"),
        (["{all}", "queries={image}"], "queries= does not go with task=cosfire"),
        (["{all}", "prototype={out}/none.png"], "none.png does not exist"),
        (["{all}", "prototype={folder}"], "is a folder, not one image"),
        (["{all}", "point=220,10"], "point=220,10 lies outside the prototype of 220x160 pixels"),
        (["{all}", "input={folder}/*.tif"], "no photo there"),
        (["{all}", "output={image}"], "is not a folder that can be written to"),
        (["{all}", "run=x", "outputs={out}"], "run=x: no run"),
        (["{all}", "treshold=0.5"], "Did you mean threshold=0.5?"),
    ],
)
def test_mistakes_in_commands_are_told(tmp_path, arguments, says):
    image = drawn(tmp_path / "a.png")
    whole = ["task=cosfire", f"prototype={image}", f"input={image}", f"output={tmp_path}/out"]
    given = whole if "{all}" in arguments else []
    given = [*given, *(a.format(image=image, out=tmp_path / "out", folder=tmp_path) for a in arguments if a != "{all}")]
    words = {word.partition("=")[0]: word for word in given}
    with pytest.raises(UserError, match=re.escape(says)):
        predict.main(list(words.values()))
