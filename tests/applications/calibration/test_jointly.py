"""What the network, lines and other evidence make of a photo together, through the calibrator."""

import math
from dataclasses import replace

import numpy as np
import pytest
from baselines.calibration.drawings import cameras, picture
from cli.photo_calibration.fakes import Fake, exif
from PIL import Image

from sextant.applications import FailedPhoto, PhotoCalibrator
from sextant.baselines.calibration import JointEstimate, LineEvidence, PhotoPrior
from sextant.chapters.calibration.confidence import confidence
from sextant.chapters.calibration.inference import find_cameras
from sextant.chapters.calibration.jointly import (
    MULTIPLES,
    NETWORK_SCALE,
    RIVALS,
    WIDE,
    _adopted,
    _held,
    _little,
    _no_axes,
    by_method,
    network_belief,
)

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
    assert usual[[0, 1, 3]] == pytest.approx((NETWORK_SCALE * half)[[0, 1, 3]])
    assert usual[2] == pytest.approx(NETWORK_SCALE[2] * half[2] * (1 + half[2] / math.radians(8)))  # vaguer, less
    assert belief(3.0)[0] == pytest.approx(3 * usual)


def test_a_network_and_lines_that_disagree_are_told(image):
    sure = Fake(tilt=0.6, roll=0.0, scale=(0.01, 0.01, 0.03, 0.02))
    joint = said("joint", image, sure)
    assert joint.verdict != "good"
    assert "disagree" in " ".join(joint.reasons) or abs(joint.tilt_deg - math.degrees(0.6)) < 5


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.fixture(scope="module")
def finding(image):
    (found,) = find_cameras(Fake(tilt=0.0, roll=0.0, scale=WRONG), [("a", image)], look_at_lines=True)
    return found


@pytest.mark.parametrize("raised", [np.linalg.LinAlgError("Singular matrix"), ValueError("Residuals are not finite")])
def test_a_photo_whose_numbers_fail_ends_no_other(image, raised, monkeypatch):
    real, calls = LineEvidence.of, []

    def of(seen):
        calls.append(seen)
        if len(calls) == 1:
            raise raised
        return real(seen)

    monkeypatch.setattr("sextant.chapters.calibration.inference.LineEvidence.of", of)
    first, second = PhotoCalibrator(Fake(scale=WRONG)).calibrate_many([image, image], errors="return")
    assert isinstance(first, FailedPhoto)
    assert "photos[0] could not be calibrated" in first.error.problem
    assert second.name == "photos[1]"


def test_a_width_that_is_no_number_is_not_good(finding):
    model = Fake()
    for width in (math.nan, math.inf):
        half = {level: np.array([width, 0.01, 0.01, 0.01]) for level in ("68", "95")}
        for network in (None, finding):
            verdict, reasons, _ = confidence(replace(finding, half=half, network=network), model)
            assert verdict == "not trustworthy"
            assert "tilt" in reasons[0]
    covariance = np.diag([-1e-4, 1e-4, 1e-4, 1e-4])
    estimate = JointEstimate(np.zeros(4), covariance, np.array([5, 5, 5]), 0.0, ())
    assert _adopted(finding, estimate, 4 / 3).half["68"][0] == math.inf
    with pytest.raises(ArithmeticError, match="did not converge"):
        _adopted(finding, replace(estimate, vector=np.full(4, math.nan)), 4 / 3)


@pytest.mark.parametrize(
    ("support", "rivals", "says"),
    [
        ((5, 9, 3), 0.1, None),
        ((3, 3, 3), 0.0, "few lines constrain the lens: 3+3+3 long segments"),
        ((2, 40, 2), 0.0, "few lines constrain the lens"),
        ((9, 0, 9), 0.0, None),
        ((5, 9, 3), RIVALS + 0.1, "another camera fits the photo nearly as well, with a probability of 30%"),
    ],
)
def test_a_lens_by_few_lines_or_with_a_rival_is_doubted(support, rivals, says):
    doubts = _little(JointEstimate(np.zeros(4), np.eye(4), np.array(support), rivals, ()))
    assert (says in doubts[0]) if says else doubts == []


@pytest.mark.parametrize(
    ("support", "says"),
    [
        ((5, 9, 3), []),
        ((2, 1, 3), []),
        ((9, 0, 9), ["no vertical axis: no long segment points up or down"]),
        ((2, 0, 1), ["no frame: along none of three axes are there 3 long segments"]),
    ],
)
def test_a_picture_without_a_frame_or_a_vertical_axis_is_told(support, says):
    assert _no_axes(JointEstimate(np.zeros(4), np.eye(4), np.array(support), 0.0, ())) == says


def test_people_hold_cameras_as_level_as_ever_where_a_network_knows_nothing(finding):
    assert _held(network_belief(finding)) == pytest.approx(WIDE, rel=0.5)
    assert _held(network_belief(replace(finding, half={"68": np.full(4, np.inf)})))[:2] == pytest.approx(
        PhotoPrior.sigma[:2]
    )
    unsure = [by_method(replace(finding, strangeness=strange), "joint") for strange in (1e6, 0.0)]
    lines = by_method(finding, "lines")
    assert float(unsure[0].camera.tilt) == pytest.approx(float(lines.camera.tilt), abs=1e-3)


def test_the_lens_that_is_reported_is_of_the_family_that_was_fitted(finding):
    joint = by_method(replace(finding, family="zero"), "joint")
    assert joint.family == "lopez"
    assert float(joint.k2) != 0


def test_lines_alone_are_not_doubted_for_what_the_network_sees(image):
    odd = Fake(tilt=0.0, roll=0.0, scale=WRONG)
    odd.strangeness = 3.0
    assert any("does not resemble" in reason for reason in said("network", image, odd).reasons)
    assert not any("does not resemble" in reason for reason in said("lines", image, odd).reasons)


def test_a_photo_that_was_cropped_is_weak_at_best(image, tmp_path):
    block = exif(35)
    block.get_ifd(0x8769)[0xA002], block.get_ifd(0x8769)[0xA003] = 4000, 2250
    Image.fromarray(image).save(tmp_path / "a.jpg", quality=95, exif=block)
    camera = said("joint", tmp_path / "a.jpg")
    assert camera.verdict != "good"
    assert any("cropped" in reason for reason in camera.reasons)


@pytest.mark.slow
def test_intervals_of_photos_of_one_camera_keep_what_all_share(image):
    """Ten times the same photo is one piece of evidence but for its lines, and tilt is as unsure as the lens."""
    dull = np.random.default_rng(0).integers(60, 80, (300, 400, 3)).astype(np.uint8)
    calibrator = PhotoCalibrator(Fake(tilt=0.2, roll=0.0, scale=WRONG))
    alone, one = calibrator.calibrate(dull), calibrator.one_camera([dull] * 6).cameras[0]
    width = [float(np.ptp(np.log(camera.interval_68.focal_px))) for camera in (alone, one)]
    assert width[1] > 0.8 * width[0]
    far = float(np.ptp(np.log(one.interval_95.focal_px)))
    assert far / width[1] == pytest.approx(MULTIPLES["95"][2] / MULTIPLES["68"][2], rel=0.35)
    assert np.ptp(one.interval_68.tilt_deg) > 0.7 * np.ptp(alone.interval_68.tilt_deg)


@pytest.mark.slow
def test_exif_that_contradicts_photos_of_one_camera_is_left_out_with_a_word(image, tmp_path):
    for name in ("a.jpg", "b.jpg"):
        Image.fromarray(image).save(tmp_path / name, quality=95, exif=exif(200))
    calibrator = PhotoCalibrator(Fake(tilt=0.0, roll=0.0, scale=WRONG))
    paths = [tmp_path / "a.jpg", tmp_path / "b.jpg"]
    free, prior = (calibrator.one_camera(paths, focal_prior=known) for known in (None, "exif"))
    assert prior.focal_of_longer_side == free.focal_of_longer_side
    assert "it was not used" in " ".join(prior.doubts)
