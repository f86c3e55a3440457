import math

import numpy as np
import pytest
import torch
from cli.photo_calibration.fakes import SCALE, Fake, calibrate, camera_of, photo
from PIL import Image

from sextant.geometry.conversions import colmap_from_perspective, opencv_from_perspective


def test_other_programs_conventions_are_those_of_the_conversions(tmp_path):
    (row,) = calibrate([photo(tmp_path / "a.png", (161, 120))], tmp_path / "out")
    matrix, distortion = opencv_from_perspective(camera_of(row))
    np.testing.assert_allclose(row["opencv"]["matrix"], matrix)
    np.testing.assert_allclose(row["opencv"]["distortion"], distortion)
    np.testing.assert_allclose(row["colmap"]["parameters"], colmap_from_perspective(camera_of(row)))


@pytest.mark.parametrize("size", [(80, 60), (60, 80), (200, 60), (64, 64), (97, 41)])
def test_parameters_are_mapped_back_to_the_whole_photo(tmp_path, size):
    model = Fake()
    (row,) = calibrate([photo(tmp_path / "a.png", size)], tmp_path / "out", model)
    width, height = size
    part = min(height, width / model.seen[0])
    assert row["focal_px"] == pytest.approx(0.7 * part, rel=1e-5)
    assert row["seen"]["height"] == pytest.approx(part)
    assert row["seen"]["left"] == pytest.approx((width - row["seen"]["width"]) / 2)
    assert row["vfov_deg"] == pytest.approx(math.degrees(2 * math.atan(height / 2 / row["focal_px"])))
    # the field of view with distortion is the angle between the rays at the middles of the edges
    edges = torch.tensor([[0, height / 2], [width, height / 2], [width / 2, 0], [width / 2, height]]).double()
    left, right, top, bottom = camera_of(row).bearings(edges)
    assert row["true_hfov_deg"] == pytest.approx(math.degrees(math.acos(left @ right)))
    assert row["true_vfov_deg"] == pytest.approx(math.degrees(math.acos(top @ bottom)))


@pytest.mark.slow
def test_a_photo_turned_by_exif_is_that_of_the_upright_one(tmp_path):
    turned = Image.Exif()
    turned[0x0112] = 6
    upright = calibrate([photo(tmp_path / "a.png", (60, 80))], tmp_path / "1")[0]
    rotated = calibrate([photo(tmp_path / "b.png", (80, 60), exif=turned)], tmp_path / "2")[0]
    assert rotated["exif_orientation"] == 6
    for key in ("focal_px", "width", "height", "opencv", "seen", "intervals"):
        assert rotated[key] == upright[key]


@pytest.mark.slow
def test_intervals_are_scale_times_the_conformal_multiplier(tmp_path):
    model = Fake()
    (row,) = calibrate([photo(tmp_path / "a.png")], tmp_path / "out", model)
    for name, level in (("68", 0.68), ("95", 0.95)):
        half = np.array(SCALE) * float(model.scores[math.ceil(101 * level) - 1, 0])
        said = row["intervals"][name]
        np.testing.assert_allclose(np.radians(said["tilt_deg"]), [0.1 - half[0], 0.1 + half[0]], rtol=1e-5)
        np.testing.assert_allclose(np.radians(said["roll_deg"]), [-0.05 - half[1], -0.05 + half[1]], rtol=1e-5)
        vfov = 2 * math.atan(0.5 / 0.7)
        np.testing.assert_allclose(np.radians(said["vfov_deg"]), [vfov - half[2], vfov + half[2]], rtol=1e-5)
        focal = 60 / 2 / np.tan(np.radians(said["vfov_deg"]) / 2)
        np.testing.assert_allclose(said["focal_px"], focal[::-1], rtol=1e-5)
        np.testing.assert_allclose(np.array(said["k1"]) / 0.49, [-0.3 - half[3], -0.3 + half[3]], rtol=1e-5)
