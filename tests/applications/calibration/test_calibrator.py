import math
import weakref
from dataclasses import replace

import numpy as np
import pytest
import torch
from cli.photo_calibration.fakes import Fake, exif, photo
from PIL import Image
from support import imported_anew, torchs_settings_unchanged
from tiny_calibration import CAMERAS, tiny_checkpoint, tiny_module

import sextant
from sextant.applications import FailedPhoto, FailedPhotosError, PhotoCalibrator
from sextant.chapters.calibration.network import reported
from sextant.errors import ArgumentError, UserError
from sextant.geometry import CameraParameters, Parameterization, undistort_radius
from sextant.kit.trained import read_trained
from sextant.runs.checkpoint import KEY

#: the last is there, but takes longer to import than a photo to calibrate
BLOCKED = ("hydra", "omegaconf", "pytorch_lightning", "lightning", "mlflow", "rich", "matplotlib", "scipy.stats")


@pytest.fixture
def calibrator():
    return PhotoCalibrator(Fake(), "network")


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    return tiny_checkpoint(tmp_path_factory.mktemp("run") / "last.ckpt")


tell = Fake.predict


def noise(height=60, width=80):
    return np.random.default_rng(0).integers(0, 256, (height, width, 3), np.uint8)


def test_a_file_and_its_pixels_are_one_photo(calibrator, tmp_path, monkeypatch):
    from_file = calibrator.calibrate(photo(tmp_path / "a.png"))
    from_bytes = calibrator.calibrate(np.full((60, 80, 3), 70, np.uint8))
    assert (from_file.name, from_bytes.name) == (str(tmp_path / "a.png"), "the photo")
    assert from_file.row() | {"file": ""} == from_bytes.row() | {"file": ""}
    assert from_file.focal_px == pytest.approx(42, rel=1e-6)
    assert calibrator.calibrate(str(tmp_path / "a.png")) == from_file
    monkeypatch.setenv("HOME", str(tmp_path))
    assert calibrator.calibrate("~/a.png").row() | {"file": ""} == from_bytes.row() | {"file": ""}
    assert calibrator.calibrate(Image.open(tmp_path / "a.png")).row() == from_bytes.row()


@pytest.mark.parametrize(
    ("wrong", "kind", "fix"),
    [
        ([noise()], "list", "Give its file"),
        (None, "NoneType", "Give its file"),
        (3, "int", "Give its file"),
        (b"\xff\xd8", "bytes", r"PIL.Image.open\(io.BytesIO"),
    ],
)
def test_what_is_no_photo_is_refused_with_its_type(calibrator, wrong, kind, fix):
    said = f"the photo is of type {kind}; a photo is a file, an array of RGB values from 0 to 255, .*\n.*{fix}"
    with pytest.raises(UserError, match=said):
        calibrator.calibrate(wrong)


def test_what_the_network_saw_is_told_in_whole_pixels(calibrator, tmp_path, monkeypatch):
    monkeypatch.setattr(Fake, "predict", lambda self, images, aspect: tell(self, images[..., :18, :24], aspect))
    calibrator.network.spec = replace(calibrator.network.spec, aspects=(1.1,), width=80, height=70)
    (said,) = [each for each in calibrator.calibrate(photo(tmp_path / "a.png")).reasons if "fewer than" in each]
    assert "of 80x60 pixels the network used 66x60, fewer than the 80x70" in said


def test_what_a_run_trained_calibrates_without_its_module(checkpoint, tmp_path):
    """The state of the module of training, under the same names, is that of the network alone."""
    module, _ = tiny_module()
    calibrator = sextant.PhotoCalibrator.load(checkpoint, tmp_path)
    images, aspect = torch.from_numpy(noise(18, 24)).permute(2, 0, 1)[None], torch.tensor([4 / 3])
    ours, theirs = calibrator.network.predict(images, aspect), module.predict(images, aspect)
    for found, expected in zip(ours.parameters, theirs.parameters, strict=True):
        assert torch.equal(found, expected)
    assert torch.equal(ours.scale, theirs.scale)
    assert torch.equal(ours.scores, theirs.scores)
    assert torch.equal(ours.strangeness, theirs.strangeness)
    assert list(calibrator.network.state_dict()) == list(module.state_dict())
    position = calibrator.network.position(CAMERAS, torch.full((9,), 4 / 3))
    assert position.min() > 0
    assert position.max() < 1
    camera = calibrator.calibrate(noise(120, 160))
    assert 0.4 * 120 < camera.focal_px < 1.6 * 120


def test_neither_hydra_nor_lightning_nor_mlflow_need_be_there(checkpoint, tmp_path, capfd):
    with imported_anew(*BLOCKED) as anew:
        assert anew.PhotoCalibrator is not PhotoCalibrator
        calibrator = anew.PhotoCalibrator.load(checkpoint)
        camera = calibrator.calibrate(photo(tmp_path / "a.png"))
        matrix, _ = camera.opencv()
        assert camera.focal_px == matrix[0, 0]
        assert len(calibrator.one_camera([camera.name, camera.name]).cameras) == 2
    assert sextant.PhotoCalibrator is PhotoCalibrator
    assert capfd.readouterr() == ("", "")


def test_another_task_is_refused(checkpoint):
    content = read_trained(checkpoint)
    content[KEY]["task"] = "classification"
    with pytest.raises(UserError, match="is a model of classification, not of calibration"):
        PhotoCalibrator.of(content, checkpoint)


@pytest.mark.parametrize(
    ("image", "says"),
    [
        (np.zeros((60, 80), np.uint8), "the photo is uint8 60x80; a photo is uint8, height x width x 3"),
        (np.zeros((60, 80, 3)), "the photo is float64 60x80x3"),
        (np.zeros((3, 60, 80), np.uint8), "the photo is uint8 3x60x80"),
        (np.zeros((31, 80, 3), np.uint8), "the photo has 80x31 pixels"),
        ("gone.jpg", "gone.jpg does not exist"),
    ],
)
def test_what_is_no_photo_is_refused(calibrator, image, says):
    with pytest.raises(UserError, match=says):
        calibrator.calibrate(image)


def test_a_folder_is_no_photo(calibrator, tmp_path):
    for folder in (tmp_path, str(tmp_path), ""):
        with pytest.raises(UserError, match="is a folder; a photo is a file"):
            calibrator.calibrate(folder)


@pytest.mark.parametrize(("wrong", "kind"), [(3, "int"), (None, "NoneType"), (Image.new("RGB", (80, 60)), "Image")])
def test_what_is_not_several_photos_is_refused_with_its_type(calibrator, wrong, kind):
    for call in (calibrator.calibrate_many, calibrator.one_camera):
        with pytest.raises(UserError, match=f"photos is of type {kind}; several photos are expected"):
            call(wrong)


@pytest.fixture
def five(tmp_path):
    """Four photos and, third, a broken file."""
    paths = [photo(tmp_path / f"{i}.png", grey=60 + 2 * i) for i in range(5)]
    paths[2].write_bytes(b"nothing")
    return paths


def test_one_broken_file_of_many_is_named_and_loses_nothing_if_failures_are_asked_for(calibrator, five):
    found = calibrator.calibrate_many(five, errors="return")
    assert [type(each) is FailedPhoto for each in found] == [False, False, True, False, False]
    assert found[2].name == str(five[2])
    assert "cannot be decoded (7 bytes)" in found[2].error.problem
    assert found[4] == calibrator.calibrate(five[4])


def test_unless_asked_for_a_failure_raises_and_all_are_named(calibrator, five):
    five[4].write_bytes(b"")
    with pytest.raises(FailedPhotosError, match=r"(?s)2 of 5 photos .*2\.png.*4\.png.*errors=.return.") as raised:
        calibrator.calibrate_many(five)
    assert [each.name for each in raised.value.failed] == [str(five[2]), str(five[4])]
    assert calibrator.calibrate_many([]) == []


def test_photos_of_one_camera_with_a_broken_file_among_them(calibrator, five):
    with pytest.raises(FailedPhotosError, match="1 of 5 photos"):
        calibrator.one_camera(five)
    one = calibrator.one_camera(five, errors="return")
    assert [type(each) is FailedPhoto for each in one.photos] == [False, False, True, False, False]
    assert len(one.fusion.kept) == len(one.cameras) == 4
    assert [camera.focal_px for camera in one.cameras] == pytest.approx([80 * one.focal_of_longer_side] * 4)
    with pytest.raises(FailedPhotosError, match="none of 1 photo could"):
        calibrator.one_camera(five[2:3], errors="return")
    with pytest.raises(UserError, match="there is no photo of the camera"):
        calibrator.one_camera([])


def test_photos_may_come_one_by_one_and_are_not_kept(calibrator, monkeypatch):
    monkeypatch.setattr("sextant.chapters.calibration.inference.BATCH", 3)
    alive = []

    def photos():
        for grey in range(60, 70):
            image = np.full((60, 80, 3), grey, np.uint8)
            alive.append(weakref.ref(image))
            yield image
            del image
            assert sum(each() is not None for each in alive) <= 1

    found = calibrator.calibrate_many(photos())
    assert [camera.name for camera in found[:2]] == ["photos[0]", "photos[1]"]
    assert [camera.focal_px for camera in found] == pytest.approx([0.6 * grey for grey in range(60, 70)], rel=1e-5)


@pytest.mark.parametrize("prior", [0, -3.0, True, math.nan, math.inf, "EXIF", np.array([600.0, 600.0]), ["exif"]])
def test_a_prior_that_has_no_meaning_is_refused(calibrator, prior, tmp_path):
    for calibrate in (calibrator.calibrate_many, calibrator.one_camera):
        with pytest.raises(UserError, match=r"focal_prior=.* must be None, exif or a focal length"):
            calibrate([photo(tmp_path / "a.png")], focal_prior=prior)
        with pytest.raises(UserError, match=r"gravity_prior=.* must be None or exif"):
            calibrate([photo(tmp_path / "a.png")], gravity_prior=prior)


@pytest.mark.parametrize("prior", [0.5, 1e9])
def test_a_prior_that_no_photo_can_have_is_refused(calibrator, prior, tmp_path):
    for calibrate in (calibrator.calibrate_many, calibrator.one_camera):
        with pytest.raises(UserError, match="of a photo 60 pixels high must be from 9 to 3600 pixels"):
            calibrate([photo(tmp_path / "a.png")], focal_prior=prior)


def test_a_folder_is_not_photos(calibrator, tmp_path):
    for calibrate in (calibrator.calibrate_many, calibrator.one_camera):
        with pytest.raises(UserError, match="is one path; several photos are expected"):
            calibrate(str(tmp_path))
        with pytest.raises(UserError, match="errors=ignore must be one of raise, return"):
            calibrate([], errors="ignore")


def test_a_photo_is_straightened_at_any_size(calibrator, tmp_path):
    camera = calibrator.calibrate(photo(tmp_path / "a.png"))
    image = noise()
    straight, focal = camera.undistort(image)
    assert straight.shape == image.shape
    large, focal_of_large = camera.undistort(image.repeat(2, 0).repeat(2, 1), "all")
    assert large.shape == (120, 160, 3)
    assert focal_of_large < 2 * focal
    with pytest.raises(UserError, match=r"the image has 60x80 pixels, but .*a\.png has 80x60"):
        camera.undistort(image.transpose(1, 0, 2))


def test_what_can_be_calibrated_can_be_straightened_and_drawn(calibrator, tmp_path):
    camera = calibrator.calibrate(photo(tmp_path / "a.png"))
    path, picture = tmp_path / "noise.png", Image.fromarray(noise())
    picture.save(path)
    expected, focal = camera.undistort(noise(), "all")
    for image in (path, str(path), picture):
        found, same = camera.undistort(image, "all")
        assert (same, found.tobytes()) == (focal, expected.tobytes())
        assert np.array_equal(camera.drawn(image).image, noise())
    assert np.array_equal(camera.undistort(noise()[..., 0], "all")[0], expected[..., 0])
    linear = camera.undistort(noise().astype(np.float32), "all")[0]
    assert linear.dtype == np.float32
    assert np.abs(linear.clip(0, 255) - expected).max() < 1.5  # bytes are clipped
    with pytest.raises(UserError, match="the image is float64 60x80x3"):
        camera.drawn(noise() / 255)
    for wrong, says in (
        ([noise()], "the image is of type list.*\nGive its file.$"),
        (None, "the image is of type NoneType"),
        (noise()[0, 0], "the image is uint8 3"),
        ("gone.png", "gone.png does not exist"),
    ):
        with pytest.raises(UserError, match=says):
            camera.undistort(wrong)
    with pytest.raises(ArgumentError, match="keep='none' must be one of crop, all"):
        camera.undistort(noise(), keep="none")


def test_loading_leaves_torch_as_it_was(checkpoint, tmp_path):
    picture, expected = noise(), PhotoCalibrator.load(checkpoint, tmp_path, method="network").calibrate(noise())
    with torchs_settings_unchanged(torch.float64):
        calibrator = PhotoCalibrator.load(checkpoint, tmp_path, method="network")
    assert {each.dtype for each in calibrator.network.parameters()} == {torch.float32}
    assert calibrator.calibrate(picture) == expected


def test_the_aspect_that_the_network_gets_does_not_depend_on_torchs_default_type(calibrator):
    with torchs_settings_unchanged(torch.float64):
        calibrator.calibrate(noise())
    assert calibrator.network.seen == torch.tensor([4 / 3]).tolist()


def test_opencv_straightens_with_what_it_is_given_as_we_do(calibrator, tmp_path):
    import cv2

    camera = calibrator.calibrate(photo(tmp_path / "a.png", (160, 120)))
    image = cv2.GaussianBlur(noise(120, 160), (0, 0), 3)
    ours, focal = camera.undistort(image)
    matrix, distortion = camera.opencv()
    new = matrix.copy()
    new[0, 0] = new[1, 1] = focal
    theirs = cv2.undistort(image, matrix, distortion, newCameraMatrix=new)
    inside = np.s_[10:-10, 10:-10]
    assert np.abs(ours[inside].astype(int) - theirs[inside].astype(int)).max() <= 3
    assert camera.colmap() == ("RADIAL", [camera.focal_px, 80, 60, camera.k1, camera.k2])


def test_a_figure_is_made_if_asked_for(calibrator, tmp_path):
    from sextant.chapters.calibration.figures.overlay import calibration_overlay

    camera = calibrator.calibrate(photo(tmp_path / "a.jpg", exif=exif(24)))
    drawn = camera.drawn(np.asarray(Image.open(tmp_path / "a.jpg")))
    assert drawn.caption[0] == "a.jpg: weak"
    assert calibration_overlay(drawn).axes


def test_sextants_own_reports_are_in_the_order_that_is_assumed_here():
    camera = CameraParameters(*torch.tensor([0.1, 0.2, 0.7, -0.2]).double())
    tilt, roll, vfov, k1_hat = reported(camera).tolist()
    assert (tilt, roll) == pytest.approx((0.1, 0.2))
    assert vfov == pytest.approx(2 * math.atan(0.5 / 0.7))
    assert k1_hat == pytest.approx(-0.2 / 0.49)
    assert Parameterization().names[1:] == ("roll", "vfov", "k1_hat")
    assert undistort_radius(torch.tensor(0.0), torch.tensor(-0.2), torch.tensor(0.03)) == 0
