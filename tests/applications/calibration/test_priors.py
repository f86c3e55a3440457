import math

import numpy as np
import pytest
import torch
from cli.photo_calibration.fakes import Fake, calibrate, exif, photo

from sextant.applications import PhotoCalibrator
from sextant.errors import UserError
from sextant.geometry import rho_from_tilt


def offset(row):
    """Where the horizon is seen, in pixels."""
    focal, tilt = torch.tensor(row["focal_px"]).double(), torch.tensor(math.radians(row["tilt_deg"])).double()
    return float(rho_from_tilt(tilt, focal, torch.tensor(row["k1"]).double(), torch.tensor(row["k2"]).double()))


@pytest.mark.slow
@pytest.mark.parametrize("size", [(80, 60), (60, 80)])
def test_a_prior_moves_the_focal_length_and_keeps_the_picture(tmp_path, size):
    path = photo(tmp_path / "a.png", size)
    (free,) = calibrate([path], tmp_path / "1")
    (held,) = calibrate([path], tmp_path / "2", focal_prior=60.0)
    assert abs(math.log(held["focal_px"] / 60)) < 0.5 * abs(math.log(free["focal_px"] / 60))
    assert held["k1_hat"] == pytest.approx(free["k1_hat"], rel=1e-5)  # seen distortion
    assert offset(held) == pytest.approx(offset(free), rel=1e-5)  # seen horizon
    assert np.ptp(held["intervals"]["68"]["focal_px"]) < np.ptp(free["intervals"]["68"]["focal_px"])
    assert any("disagree" in reason for reason in held["confidence"]["reasons"])


def test_a_prior_that_agrees_changes_little_and_is_not_doubted(tmp_path):
    (held,) = calibrate([photo(tmp_path / "a.png")], tmp_path / "out", focal_prior=42.3)
    assert held["focal_px"] == pytest.approx(42.2, abs=0.2)
    assert held["confidence"] == {**held["confidence"], "verdict": "good", "reasons": []}
    assert held["intervals_by"].startswith("focal_prior=42.3")


@pytest.mark.parametrize("number", [np.float32(42.5), np.int64(42)])
def test_a_focal_length_is_a_number_of_any_type(tmp_path, number):
    small, large = photo(tmp_path / "a.png"), photo(tmp_path / "b.png", (160, 120))
    calibrator = PhotoCalibrator(Fake(), "network")
    found, same = (calibrator.calibrate(small, focal_prior=each) for each in (number, float(number)))
    assert found.focal_px == same.focal_px
    with pytest.raises(UserError, match=f"focal_prior={number:g}: the photos have longer sides"):
        calibrator.one_camera([small, large], focal_prior=number)
    for wrong in (True, np.bool_(True), -number, np.float32("nan"), "42"):
        with pytest.raises(UserError, match="must be None, exif or a focal length"):
            calibrator.calibrate(small, focal_prior=wrong)


@pytest.mark.slow
def test_exif_as_a_prior(tmp_path):
    told, silent = photo(tmp_path / "a.jpg", exif=exif(20)), photo(tmp_path / "b.jpg")
    rows = calibrate([told, silent], tmp_path / "out", focal_prior="exif")
    assert 42.1 < rows[0]["focal_px"] < rows[0]["exif_focal_px"] == pytest.approx(46.2, abs=0.1)
    assert rows[1]["focal_px"] == pytest.approx(42, abs=0.1)
    assert "EXIF contains no focal length: none was used" in rows[1]["confidence"]["reasons"]
