import json
import math

import pytest
from cli.photo_calibration.fakes import Fake, calibrate, exif, photo


@pytest.mark.parametrize(
    ("model", "size", "verdict", "says"),
    [
        (Fake(), (80, 60), "good", None),
        (Fake(scale=(0.12, 0.01, 0.03, 0.05)), (80, 60), "weak", "tilt: 68 % interval"),
        (Fake(scale=(0.02, 0.01, 0.03, 0.5)), (80, 60), "not trustworthy", "apparent distortion: 68 % interval"),
        (Fake(scores=1), (80, 60), "not trustworthy", "field of view: 68 % interval ±inf"),
        (Fake(scale=(float("nan"), 0.01, 0.03, 0.05)), (80, 60), "not trustworthy", "tilt"),
        (Fake(), (400, 60), "weak", "saw only 20% of the photo"),
        (Fake(), (32, 32), "good", None),
        (Fake(place=0.995), (80, 60), "weak", "at the end of what the network was trained on"),
        (Fake(place=float("nan")), (80, 60), "weak", "at the end"),
    ],
)
def test_low_confidence_is_said(tmp_path, capsys, model, size, verdict, says):
    (row,) = calibrate([photo(tmp_path / "a.png", size)], tmp_path / "out", model)
    assert row["confidence"]["verdict"] == verdict
    text = " ".join(row["confidence"]["reasons"])
    assert (says in text) if says else text == ""
    json.loads((tmp_path / "out" / "a.json").read_text(), parse_constant=pytest.fail)  # no NaN or Infinity


def test_a_photo_smaller_than_the_input_is_weak(tmp_path, monkeypatch):
    monkeypatch.setattr(Fake, "input_width", 24)
    model = Fake()
    model.input_width, model.input_height = 40, 36
    model.predict = lambda images, aspect: Fake.predict(Fake(), images[:, :, :18, :24], aspect)
    (row,) = calibrate([photo(tmp_path / "a.png", (32, 32))], tmp_path / "out", model)
    assert row["confidence"]["verdict"] == "weak"
    assert "32x32 pixels are fewer than the 40x36" in row["confidence"]["reasons"][0]


def test_a_focal_length_by_exif_that_disagrees_is_told_though_not_used(tmp_path):
    agrees = photo(tmp_path / "a.jpg", exif=exif(24))  # 24 mm of 43.3: 55 px on this diagonal; the network says 42
    (row,) = calibrate([agrees], tmp_path / "out")
    assert row["exif_focal_px"] == pytest.approx(24 * 100 / math.hypot(36, 24))
    assert row["focal_px"] == pytest.approx(42, rel=1e-5)
    assert "EXIF tells a focal length of 55 px, outside the 95 % interval" in row["confidence"]["reasons"]
