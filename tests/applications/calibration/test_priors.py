import math

import numpy as np
import pytest
import torch
from cli.photo_calibration.fakes import calibrate, exif, photo

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


@pytest.mark.slow
def test_exif_as_a_prior(tmp_path):
    told, silent = photo(tmp_path / "a.jpg", exif=exif(20)), photo(tmp_path / "b.jpg")
    rows = calibrate([told, silent], tmp_path / "out", focal_prior="exif")
    assert 42.1 < rows[0]["focal_px"] < rows[0]["exif_focal_px"] == pytest.approx(46.2, abs=0.1)
    assert rows[1]["focal_px"] == pytest.approx(42, abs=0.1)
    assert "EXIF contains no focal length: none was used" in rows[1]["confidence"]["reasons"]
