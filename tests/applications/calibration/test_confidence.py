import json
import math
from dataclasses import replace

import pytest
import torch
from cli.photo_calibration.fakes import Fake, calibrate, exif, photo

from sextant.chapters.calibration.confidence import ENDS, _distinct
from sextant.geometry import vfov_from_focal

#: five degrees of field of view at 68 %, for the scores' quantile is 1.38, and seven at 95 %
SURE = (0.02, 0.01, math.radians(5) / 1.38, 0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "size", "verdict", "says"),
    [
        (Fake(), (80, 60), "good", None),
        (Fake(scale=(0.12, 0.01, 0.03, 0.05)), (80, 60), "weak", "tilt: 68 % interval"),
        (Fake(scale=(0.02, 0.01, 0.03, 0.5)), (80, 60), "not trustworthy", "apparent distortion: 68 % interval"),
        (Fake(scores=1), (80, 60), "not trustworthy", "field of view: the 68 % interval is unbounded"),
        (Fake(scale=(float("nan"), 0.01, 0.03, 0.05)), (80, 60), "not trustworthy", "tilt"),
        (Fake(), (400, 60), "weak", "covers only 20% of the photo"),
        (Fake(), (32, 32), "good", None),
        (Fake(place=0.995), (80, 60), "weak", "at the end of the network's training range"),
        (Fake(place=float("nan")), (80, 60), "weak", "at the end"),
    ],
)
def test_low_confidence_is_said(tmp_path, capsys, model, size, verdict, says):
    (row,) = calibrate([photo(tmp_path / "a.png", size)], tmp_path / "out", model)
    assert row["confidence"]["verdict"] == verdict
    text = " ".join(row["confidence"]["reasons"])
    assert (says in text) if says else text == ""
    json.loads((tmp_path / "out" / "a.json").read_text(), parse_constant=pytest.fail)  # no NaN or Infinity


class Ranged(Fake):
    """The same network, which was trained on fields of view from 39 to 92 degrees, as those of ``lopez_4x3`` are."""

    low, high = 39.1, 92.2

    def position(self, camera, aspect):
        place = torch.full((len(camera.focal), 4), 0.5)
        place[:, 2] = (torch.rad2deg(vfov_from_focal(camera.focal)).float() - self.low) / (self.high - self.low)
        return ENDS + place * (1 - 2 * ENDS)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("grey", "verdict", "says"),
    [
        (70, "good", None),  # 71 degrees
        (120, "weak", "the 95 % interval extends beyond the network's training range: field of view"),  # 45
        (50, "weak", "the 95 % interval extends beyond the network's training range: field of view"),  # 90
        (150, "weak", "at the end of the network's training range: size; the true value may lie beyond it"),  # 37
    ],
)
def test_a_camera_near_the_end_of_those_trained_on_is_not_good_however_sure(tmp_path, grey, verdict, says):
    """Of a lens of 1.6 image heights, longer than any of training, 1.2 may be told, 68 % surely within five degrees."""
    (row,) = calibrate([photo(tmp_path / "a.png", grey=grey)], tmp_path / "out", Ranged(scale=SURE))
    assert row["confidence"]["verdict"] == verdict
    assert row["confidence"]["reasons"] == ([says] if says else [])


@pytest.mark.slow
def test_a_focal_length_that_is_known_takes_the_doubt_away(tmp_path):
    model, path = Ranged(scale=SURE), photo(tmp_path / "a.png", grey=120)
    (alone,) = calibrate([path], tmp_path / "1", model)
    (known,) = calibrate([path], tmp_path / "2", model, focal_prior=70.0)
    assert "extends beyond" in " ".join(alone["confidence"]["reasons"])
    assert "extends beyond" not in " ".join(known["confidence"]["reasons"])


@pytest.mark.slow
@pytest.mark.parametrize(("strange", "verdict"), [(0.0, "good"), (0.99, "good"), (1.8, "weak"), (None, "good")])
def test_a_photo_that_looks_like_nothing_trained_on_is_told(tmp_path, strange, verdict):
    model = Fake()
    model.strangeness = strange
    (row,) = calibrate([photo(tmp_path / "a.png")], tmp_path / "out", model)
    assert row["confidence"]["verdict"] == verdict
    assert ("does not resemble" in " ".join(row["confidence"]["reasons"])) == (verdict == "weak")


@pytest.mark.slow
def test_a_photo_smaller_than_the_input_is_weak(tmp_path):
    model = Fake()
    model.spec = replace(model.spec, width=40, height=36)
    model.predict = lambda images, aspect: Fake.predict(Fake(), images[:, :, :18, :24], aspect)
    (row,) = calibrate([photo(tmp_path / "a.png", (32, 32))], tmp_path / "out", model)
    assert row["confidence"]["verdict"] == "weak"
    assert "of 32x32 pixels the network used" in row["confidence"]["reasons"][0]


def test_a_focal_length_by_exif_that_disagrees_is_told_though_not_used(tmp_path):
    agrees = photo(tmp_path / "a.jpg", exif=exif(24))  # 24 mm of 43.3: 55 px on this diagonal; the network says 42
    (row,) = calibrate([agrees], tmp_path / "out")
    assert row["exif_focal_px"] == pytest.approx(24 * 100 / math.hypot(36, 24))
    assert row["focal_px"] == pytest.approx(42, rel=1e-5)
    assert "EXIF gives a focal length of 55 px, outside the 95 % interval" in row["confidence"]["reasons"]


@pytest.mark.parametrize(
    ("a", "b", "shown"),
    [
        (9.52, 9.48, ("9.52", "9.48")),
        (9.5, 9.4999, ("9.5", "9.4999")),
        (12.0, 3.0, ("12", "3")),
        (20.4, 19.6, ("20.4", "19.6")),
        (0.0123, 0.0121, ("0.0123", "0.0121")),
        (float("nan"), 2.0, ("nan", "2")),
        (float("inf"), 2.0, ("inf", "2")),
        (2.0, 2.0, ("2", "2")),
    ],
)
def test_a_width_and_the_limit_that_it_exceeds_are_told_apart(a, b, shown):
    assert _distinct(a, b) == shown
