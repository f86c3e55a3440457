"""What the network, lines and other evidence make of a photo together, through the calibrator."""

import math

import numpy as np
import pytest
from baselines.calibration.drawings import cameras, picture
from cli.photo_calibration.fakes import Fake, exif
from PIL import Image

from sextant.applications import FailedPhoto, PhotoCalibrator
from sextant.applications.calibration.inference import find_cameras
from sextant.applications.calibration.jointly import NETWORK_SCALE, network_belief
from sextant.errors import UserError

#: a camera whose picture has lines in all three directions, and a network that is wrong about it
CAMERA = list(cameras(8, k1=(-0.01, 0.0)))[1]
WRONG = (0.1, 0.06, 0.15, 0.05)


def drawn(width=400, height=300, noise=6):
    return picture(*CAMERA[:4], 0.0, width=width, height=height, noise=noise)


@pytest.fixture(scope="module")
def image():
    return drawn()


def said(method, image, model=None):
    return PhotoCalibrator(model or Fake(tilt=0.0, roll=0.0, scale=WRONG), method).calibrate(image)


def test_lines_lead_where_the_network_is_unsure_and_wrong(image):
    tilt, roll, _, focal, _ = CAMERA
    network, joint = said("network", image), said("joint", image)
    assert abs(joint.tilt_deg - math.degrees(tilt)) < 1
    assert abs(joint.tilt_deg - math.degrees(tilt)) < abs(network.tilt_deg - math.degrees(tilt))
    assert abs(joint.roll_deg - math.degrees(roll)) < 0.6
    assert joint.focal_px / 300 == pytest.approx(focal, rel=0.1)
    low, high = joint.interval_95.focal_px
    assert low < 300 * focal < high
    assert joint.intervals_by == "joint cost, calibrated on real photos"


def test_lines_alone_do_not_ask_the_network(image):
    other = Fake(tilt=0.3, roll=0.2, scale=WRONG)
    assert said("lines", image).row() == said("lines", image, other).row() | {
        "confidence": said("lines", image).row()["confidence"]
    }


def test_without_lines_the_network_leads():
    dots = np.random.default_rng(0).integers(60, 80, (300, 400, 3)).astype(np.uint8)
    sure = Fake(tilt=0.2, roll=0.05, scale=(0.004, 0.002, 0.01, 0.002))
    joint = said("joint", dots, sure)
    assert joint.tilt_deg == pytest.approx(math.degrees(0.2), abs=0.5)
    assert joint.roll_deg == pytest.approx(math.degrees(0.05), abs=0.5)


def test_a_photo_that_looks_strange_has_the_network_counted_less(image):
    def belief(strangeness):
        model = Fake()
        model.strangeness = strangeness
        (found,) = find_cameras(model, [("a", image)], look_at_lines=True)
        return np.array(network_belief(found).sigma), found.half["68"]

    usual, half = belief(0.5)
    assert usual == pytest.approx(NETWORK_SCALE * half)
    assert belief(3.0)[0] == pytest.approx(3 * usual)


def test_a_network_and_lines_that_disagree_are_told(image):
    sure = Fake(tilt=0.6, roll=0.0, scale=(0.01, 0.01, 0.03, 0.02))
    joint = said("joint", image, sure)
    assert joint.verdict != "good"
    assert "disagree" in " ".join(joint.reasons) or abs(joint.tilt_deg - math.degrees(0.6)) < 5


def test_exif_that_contradicts_the_picture_is_left_out_with_a_word(image, tmp_path):
    Image.fromarray(image).save(tmp_path / "a.jpg", quality=95, exif=exif(200))
    calibrator = PhotoCalibrator(Fake(tilt=0.0, roll=0.0, scale=WRONG))
    alone, prior = (calibrator.calibrate(tmp_path / "a.jpg", focal_prior=p) for p in (None, "exif"))
    assert prior.focal_px == alone.focal_px
    assert "it was not used" in " ".join(prior.reasons)
    right = 300 * CAMERA[3] * math.hypot(36, 24) / 500
    Image.fromarray(image).save(tmp_path / "b.jpg", quality=95, exif=exif(round(right)))
    known = calibrator.calibrate(tmp_path / "b.jpg", focal_prior="exif")
    assert known.focal_px == pytest.approx(300 * CAMERA[3], rel=0.03)
    assert "not used" not in " ".join(known.reasons)


def test_photos_of_one_camera_share_its_lens_and_keep_their_own_pose(image):
    other = picture(CAMERA[0] + 0.15, *CAMERA[1:4], 0.0, width=400, height=300, noise=6, seed=3)
    one = PhotoCalibrator(Fake(tilt=0.0, roll=0.0, scale=WRONG)).one_camera([image, other])
    first, second = one.cameras
    assert first.focal_px == pytest.approx(second.focal_px, rel=1e-9)
    assert first.k1 == pytest.approx(second.k1, rel=1e-9)
    assert second.tilt_deg - first.tilt_deg == pytest.approx(math.degrees(0.15), abs=1)


def test_what_is_no_photo_is_told():
    angle = np.linspace(0, 2 * np.pi, 512, endpoint=False)[None, :, None]
    around = 120 + 50 * np.sin(angle) + 30 * np.cos(3 * angle) + np.random.default_rng(0).normal(0, 3, (256, 512, 3))
    around[:20] = 200
    wall = np.full((300, 400, 3), 150, np.uint8)
    strip = np.random.default_rng(0).integers(0, 255, (40, 800, 3), np.uint8)
    panorama, blank, long = PhotoCalibrator(Fake()).calibrate_many(
        [around.astype(np.uint8), wall, strip], errors="return"
    )
    assert isinstance(panorama, FailedPhoto)
    assert "is a panorama of 360 degrees" in panorama.error.problem
    assert (blank.verdict, long.verdict) == ("not trustworthy", "not trustworthy")
    assert "a blank wall" in " ".join(blank.reasons)
    assert "a strip of 20:1" in " ".join(long.reasons)


def test_a_method_that_is_none_is_refused():
    with pytest.raises(UserError, match="method=best must be one of joint, lines, network"):
        PhotoCalibrator(Fake(), "best")
