"""Gravity of a phone's accelerometer among the evidence for a photo's camera."""

import math

import pytest
from data.photos.test_gravity_tags import apple_note
from PIL import Image
from sklearn.datasets import load_sample_image

from sextant import PhotoCalibrator
from sextant.data.photos.exif import EXIF_BLOCK, MAKER_NOTE
from sextant.errors import ArgumentError


@pytest.fixture(scope="module")
def calibrator():
    return PhotoCalibrator.load()


@pytest.fixture(scope="module")
def china(calibrator, tmp_path_factory):
    """A temple, and what the picture says of its camera."""
    path = tmp_path_factory.mktemp("gravity") / "china.jpg"
    Image.fromarray(load_sample_image("china.jpg")).save(path, quality=95)
    return path, calibrator.calibrate(path)


def tagged(path, folder, tilt, roll):
    """The photo as a phone held so would have tagged it, home button on the right."""
    t, r = math.radians(tilt), math.radians(roll)
    right, down, forward = math.cos(t) * math.sin(r), math.cos(t) * math.cos(r), -math.sin(t)
    exif = Image.Exif()
    exif.get_ifd(EXIF_BLOCK)[MAKER_NOTE] = apple_note(-down, -right, -forward)
    Image.open(path).save(folder / "tagged.jpg", exif=exif, quality=95)
    return folder / "tagged.jpg"


def test_gravity_decides_tilt_and_roll_and_narrows_their_intervals(china, calibrator, tmp_path):
    path, free = china
    held = calibrator.calibrate(tagged(path, tmp_path, free.tilt_deg + 3, free.roll_deg - 1), gravity_prior="exif")
    assert held.tilt_deg == pytest.approx(free.tilt_deg + 3, abs=1.5)
    assert held.roll_deg == pytest.approx(free.roll_deg - 1, abs=1.0)
    width = [camera.interval_95.tilt_deg[1] - camera.interval_95.tilt_deg[0] for camera in (held, free)]
    assert width[0] < width[1]


@pytest.mark.slow
def test_gravity_that_the_picture_contradicts_casts_doubt_used_or_not(china, calibrator, tmp_path):
    path, free = china
    wrong = tagged(path, tmp_path, free.tilt_deg + 40, free.roll_deg + 20)
    for priors in ({}, {"gravity_prior": "exif"}, {"gravity_prior": "exif", "focal_prior": 600.0}):
        camera = calibrator.calibrate(wrong, **priors)
        assert any("which the picture contradicts" in reason for reason in camera.reasons)
        assert camera.verdict != "good"
    assert calibrator.calibrate(wrong).tilt_deg == pytest.approx(free.tilt_deg, abs=1.0)


@pytest.mark.slow
def test_gravity_stays_where_the_focal_length_is_known_too_and_where_photos_are_of_one_camera(
    china, calibrator, tmp_path
):
    path, free = china
    photo = tagged(path, tmp_path, free.tilt_deg + 3, free.roll_deg)
    both = calibrator.calibrate(photo, gravity_prior="exif", focal_prior=free.focal_px)
    one = calibrator.one_camera([photo, path], gravity_prior="exif").photos[0]
    for camera in (both, one):
        assert camera.tilt_deg == pytest.approx(free.tilt_deg + 3, abs=1.5)


def test_a_photo_without_the_tag_says_so_where_it_was_asked_for(china, calibrator):
    path, free = china
    asked = calibrator.calibrate(path, gravity_prior="exif")
    assert "the metadata contain no gravity: none was used" in asked.reasons
    assert asked.tilt_deg == free.tilt_deg


def test_another_prior_is_refused(china, calibrator):
    with pytest.raises(ArgumentError, match="gravity_prior='yes' must be None or exif"):
        calibrator.calibrate(china[0], gravity_prior="yes")
