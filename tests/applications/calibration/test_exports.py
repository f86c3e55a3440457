"""Cameras in the files of other programs are compared with what those programs compute from them."""

import json
import math
import struct
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
import yaml
from cli.photo_calibration.fakes import Fake, calibrate, photo
from PIL import Image

from sextant.applications import PhotoCalibrator
from sextant.chapters.calibration.exports import (
    fspy_parameters,
    kalibr_camchain,
    nerfstudio_frame,
    ros_camera_info,
    write_exports,
)
from sextant.data.reconstructions.nerfstudio import read_nerfstudio
from sextant.errors import ArgumentError, UserError
from sextant.geometry import PerspectiveCamera, tilt_roll_from_up


@pytest.fixture
def camera(tmp_path):
    """A camera with strong distortion, tilt and roll, of a photo of odd size."""
    found = PhotoCalibrator(Fake(tilt=0.3, roll=-0.2), "network").calibrate(photo(tmp_path / "a.png", (161, 120)))
    return replace(found, k1=-0.11, k2=0.02)


def rays(camera, points):
    """Unit rays (x right, y down, z forward) of points whose first pixel has its centre at (0.5, 0.5)."""
    ours = PerspectiveCamera(
        *(torch.tensor(x, dtype=torch.float64) for x in (camera.focal_px / camera.height, camera.k1, camera.k2)),
        camera.width,
        camera.height,
    )
    return ours.bearings(torch.from_numpy(points)).numpy()


POINTS = np.array([[0.5, 0.5], [160.5, 119.5], [30.0, 90.0], [80.5, 60.0], [120.25, 10.75]])


def opencv_rays(matrix, distortion, points):
    found = cv2.undistortPoints(points[:, None], matrix, distortion, None, None, None, (3, 100, 1e-14))[:, 0]
    found = np.hstack([found, np.ones((len(found), 1))])
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def test_kalibr_and_ros_give_the_same_rays_by_opencv(camera):
    """radtan and plumb_bob are OpenCV's model, whose pixel centres are whole numbers."""
    chain, info = yaml.safe_load(yaml.safe_dump(kalibr_camchain(camera)))["cam0"], ros_camera_info(camera)
    fx, fy, cx, cy = chain["intrinsics"]
    assert (chain["camera_model"], chain["distortion_model"]) == ("pinhole", "radtan")
    assert chain["resolution"] == [161, 120]
    assert len(chain["distortion_coeffs"]) == 4
    expected = rays(camera, POINTS)
    kalibr = opencv_rays(
        np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), np.array(chain["distortion_coeffs"]), POINTS - 0.5
    )
    np.testing.assert_allclose(kalibr, expected, atol=1e-9)
    assert info["distortion_model"] == "plumb_bob"
    matrix, distortion = (
        np.array(info[key]["data"]).reshape(info[key]["rows"], info[key]["cols"])
        for key in ("camera_matrix", "distortion_coefficients")
    )
    assert distortion.shape == (1, 5)
    np.testing.assert_allclose(opencv_rays(matrix, distortion, POINTS - 0.5), expected, atol=1e-9)


def test_what_ros_rectifies_is_our_undistorted_photo(camera):
    """image_proc maps by initUndistortRectifyMap with K, D, R and P."""
    info = ros_camera_info(camera)
    k, d, r, p = (
        np.array(info[key]["data"]).reshape(info[key]["rows"], info[key]["cols"])
        for key in ("camera_matrix", "distortion_coefficients", "rectification_matrix", "projection_matrix")
    )
    maps = cv2.initUndistortRectifyMap(k, d, r, p, (161, 120), cv2.CV_32FC1)
    image = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (120, 161, 3), np.uint8), (0, 0), 3)
    theirs = cv2.remap(image, *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    ours, focal = camera.undistort(image)
    assert p[0, 0] == pytest.approx(focal)
    assert np.abs(theirs.astype(int) - ours).max() <= 1


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_nerfstudio_reads_back_intrinsics_gravity_and_the_stored_image(camera, tmp_path, orientation):
    turned = replace(camera, exif_orientation=orientation)
    (path,) = write_exports([turned], [], tmp_path / "out", ["nerfstudio"])
    (image,) = read_nerfstudio(path).images
    stored = (120, 161) if orientation >= 5 else (161, 120)
    assert (image.lens.model, image.lens.width, image.lens.height) == ("OPENCV", *stored)
    assert (path.parent / image.name).resolve() == (tmp_path / "a.png").resolve()
    fx, fy, cx, cy, k1, k2, p1, p2 = image.lens.opencv
    assert (fx, fy, k1, k2, p1, p2) == (camera.focal_px, camera.focal_px, camera.k1, camera.k2, 0, 0)
    assert (cx, cy) == (stored[0] / 2 - 0.5, stored[1] / 2 - 0.5)
    up = image.world_from_camera[:3, :3].T @ [0, 0, 1]  # in the stored image: x right, y down
    x, y = {1: (up[0], up[1]), 3: (-up[0], -up[1]), 6: (-up[1], up[0]), 8: (up[1], -up[0])}[orientation]
    back = tilt_roll_from_up(torch.tensor([x, y, up[2]]))
    np.testing.assert_allclose(np.degrees(back), [camera.tilt_deg, camera.roll_deg], atol=1e-9)


def test_a_mirrored_photo_has_no_pose(camera):
    with pytest.raises(UserError, match="exif_orientation=2 stores a mirror image"):
        nerfstudio_frame(replace(camera, exif_orientation=2))


@pytest.mark.parametrize("keep", ["crop", "all"])
def test_a_point_of_the_scene_is_where_fspy_says_in_the_undistorted_photo(camera, keep):
    found = fspy_parameters(camera, keep)
    _, focal = camera.undistort(np.zeros((120, 161, 3), np.uint8), keep)
    view, world = (np.array(found[key]["rows"]) for key in ("viewTransform", "cameraTransform"))
    np.testing.assert_allclose(view @ world, np.eye(4), atol=1e-12)
    # a ray of ours, in the world, through fSpy's own projection: the camera looks along -z, the plane spans [-1, 1]
    ray = np.array([0.21, -0.13, 1.0])
    x, y, z = view[:3, :3] @ (world[:3, :3] @ np.diag([1, -1, -1]) @ ray)
    plane = found["relativeFocalLength"] * np.array([x, y]) / -z
    pixel = (1 + plane[0]) * 161 / 2, 60 - plane[1] * 161 / 2
    np.testing.assert_allclose(pixel, [80.5 + focal * 0.21, 60 - focal * 0.13])
    assert found["relativeFocalLength"] == pytest.approx(1 / math.tan(found["horizontalFieldOfView"] / 2))
    # vanishing points are images of the world's axes
    for point, axis in zip(found["vanishingPoints"], view[:3, :3].T, strict=True):
        expected = found["relativeFocalLength"] * axis[:2] / -axis[2]
        np.testing.assert_allclose([point["x"], point["y"]], expected)
    # z of the world is up
    back = tilt_roll_from_up(torch.from_numpy(np.diag([1, -1, -1]) @ view[:3, :3] @ [0, 0, 1]))
    np.testing.assert_allclose(np.degrees(back), [camera.tilt_deg, camera.roll_deg], atol=1e-9)


def test_a_published_fspy_export_obeys_the_same_relations():
    """The numbers of fSpy's own export, ``test_data/json_export.json`` of its importer for Blender."""
    width, focal, hfov, vfov = 1439, 1.0230759978297743, 1.5479845321227295, 1.1518580723726943
    assert focal == pytest.approx(1 / math.tan(hfov / 2), rel=1e-12)
    assert focal == pytest.approx(956 / width / math.tan(vfov / 2), rel=1e-12)
    # a row of cameraTransform is an axis of the world in the camera, which looks along -z; this is z
    axis = np.array([-0.5374758933300462, 0.002440640853491923, -0.8432755820971537])
    np.testing.assert_allclose(focal * axis[:2] / -axis[2], [-0.652074716204382, 0.0029610261811691915], rtol=1e-6)


def test_files_of_a_folder_and_the_project_for_blender(tmp_path):
    paths = [photo(tmp_path / "in" / f"{grey} px.jpg", grey=grey) for grey in (60, 90)]
    out = tmp_path / "out"
    rows = calibrate(paths, out, exports=("nerfstudio", "fspy", "ros", "kalibr"))
    assert len(json.loads((out / "transforms.json").read_text())["frames"]) == 2
    for row in rows:
        stem = row["file"].rpartition("/")[2][:-4]
        info = yaml.safe_load((out / f"{stem}_ros.yaml").read_text())
        assert info["camera_name"] == stem.replace(" ", "_")
        assert all(isinstance(x, float) for x in info["distortion_coefficients"]["data"])
        assert yaml.safe_load((out / f"{stem}_camchain.yaml").read_text())["cam0"]["intrinsics"][0] == row["focal_px"]
        parameters = json.loads((out / f"{stem}_fspy.json").read_text())
        project = (out / f"{stem}.fspy").read_bytes()
        magic, version, state, image = struct.unpack("<4I", project[:16])
        assert (project[:4], magic, version, len(project)) == (b"fspy", 2037412710, 1, 16 + state + image)
        assert json.loads(project[16 : 16 + state])["cameraParameters"] == parameters
        (tmp_path / "background.jpg").write_bytes(project[16 + state :])
        assert Image.open(tmp_path / "background.jpg").size == (parameters["imageWidth"], parameters["imageHeight"])
        assert parameters["horizontalFieldOfView"] == pytest.approx(2 * math.atan(40 / row["undistorted"]["focal_px"]))


def test_photos_named_as_the_files_of_all_have_files_of_their_own(tmp_path):
    paths = [photo(tmp_path / "in" / f"{name}.png") for name in ("calibrations", "Transforms")]
    out = tmp_path / "out"
    calibrate(paths, out, exports=("nerfstudio",))
    assert len(json.loads((out / "calibrations.json").read_text())["photos"]) == 2
    assert len(json.loads((out / "transforms.json").read_text())["frames"]) == 2
    own = [json.loads((out / f"{name}_png.json").read_text())["file"] for name in ("calibrations", "Transforms")]
    assert own == [str(path) for path in paths]


def test_a_photo_named_as_the_export_of_another_has_files_of_its_own(tmp_path):
    paths = [photo(tmp_path / "in" / f"{name}.png") for name in ("x_FSPY", "x", "y_fspy")]
    out = tmp_path / "out"
    calibrate(paths, out, exports=("fspy",))
    own = [json.loads((out / f"{name}.json").read_text())["file"] for name in ("x_FSPY", "x_png", "y_fspy")]
    assert own == [str(path) for path in paths]
    assert "cameraTransform" in json.loads((out / "x_png_fspy.json").read_text())
    assert len(list(out.glob("*.fspy"))) == 3


def test_what_an_earlier_run_left_is_told_and_kept(tmp_path, capsys):
    first, other = photo(tmp_path / "in" / "a.png"), photo(tmp_path / "in" / "b.png")
    out = tmp_path / "out"
    calibrate([first], out, exports=("nerfstudio",))
    calibrate([first], out, exports=("nerfstudio",))
    assert "earlier run" not in capsys.readouterr().out
    calibrate([other], out)
    told = f"note: {out} also holds results of an earlier run: 1 photo, such as a.png; transforms.json"
    assert told in capsys.readouterr().out.replace("\n", "")
    assert (out / "a.json").is_file()


def test_what_cannot_be_written_is_told(tmp_path):
    with pytest.raises(UserError, match="exports=fspy: fSpy has no distortion") as error:
        calibrate([photo(tmp_path / "a.png")], tmp_path / "out", exports=("fspy",), undistort="none")
    assert "undistort=crop" in error.value.fix
    with pytest.raises(ArgumentError, match="'colmap' is none of nerfstudio, fspy, ros, kalibr"):
        write_exports([], [], tmp_path, ["colmap"])
