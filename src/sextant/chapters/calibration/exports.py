r"""Cameras of photos in the files of other programs: nerfstudio, fSpy and Blender, ROS, Kalibr.

The distortion :math:`1 + k_1 r^2 + k_2 r^4` on normalised coordinates is the radial part of the model of OpenCV, so k1
and k2 pass unchanged wherever a format has it, and all further coefficients are 0.

============ ========================= ============================ ===============================================
file         distortion                pixel (i, j) has its centre  pixels
============ ========================= ============================ ===============================================
nerfstudio   ``OPENCV``: k1 k2 p1 p2   at (i + 0.5, j + 0.5)        of the photo as stored, before EXIF orientation
fSpy         none                      at (i + 0.5, j + 0.5)        of the undistorted copy
ROS          ``plumb_bob``: k1 k2 t1   at (i, j)                    of the upright photo
             t2 k3
Kalibr       ``radtan``: k1 k2 r1 r2   at (i, j)                    of the upright photo
============ ========================= ============================ ===============================================

A photo tells gravity but neither heading nor position. Where a format asks for a pose, the world's z points up, the
camera stands at the origin and looks midway between x and y, where fSpy's vanishing points are finite.

Sources: nerfstudio, "Data conventions"; fSpy, ``solver-result.ts`` and ``coordinates-util.ts``, and its importer for
Blender, ``fspy.py`` (project files, version 1); ROS, ``camera_calibration_parsers`` and ``sensor_msgs/CameraInfo``;
Kalibr, "Yaml formats".
"""

import math
import os
import re
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
import torch
from jaxtyping import Float64
from numpy import ndarray

from sextant.applications.write_errors import telling_write_errors
from sextant.atomic_files import json_bytes, write_atomically
from sextant.chapters.calibration.options import Export, Undistort
from sextant.chapters.calibration.photo_camera import PhotoCamera
from sextant.data.photo_files import file_stems
from sextant.data.photos import Keep, straight_focal
from sextant.data.upright import STORED_FROM_UPRIGHT
from sextant.errors import ArgumentError, UserError
from sextant.geometry import rotation_from_tilt_roll

EXPORTS: tuple[Export, ...] = get_args(Export)
#: stems of the files for all photos together, which no photo's own may have
COLLECTED = ("calibrations", "transforms")
#: from the gravity frame (x right, y down, z forward) to a world whose z points up, and in which it looks to (1, 1, 0)
Z_UP = np.array([[math.sqrt(0.5), 0.0, math.sqrt(0.5)], [-math.sqrt(0.5), 0.0, math.sqrt(0.5)], [0.0, -1.0, 0.0]])
#: to a camera whose x points right, y up and z backward, from one whose y points down and z forward
BACKWARD = np.diag([1.0, -1.0, -1.0])
#: first four bytes ("fspy") and version of a project of fSpy
PROJECT = (2037412710, 1)
UNKNOWN = "heading and position are unknown: each camera stands at the origin and looks between x and y; z points up"


def nerfstudio_frame(camera: PhotoCamera) -> dict[str, Any]:
    """One of ``frames`` of nerfstudio's ``transforms.json``, without its ``file_path``.

    Raises:
        UserError: the photo is stored as a mirror image, of which no pose is right.
    """
    turn = np.eye(3)
    turn[:2, :2] = STORED_FROM_UPRIGHT[camera.exif_orientation]
    if np.linalg.det(turn) < 0:
        raise UserError(
            f"{camera.name}: exif_orientation={camera.exif_orientation} stores a mirror image, of which nerfstudio "
            "knows no camera",
            "Save the photo upright, or leave nerfstudio out of exports=.",
        )
    pose = np.eye(4)
    pose[:3, :3] = _world_from_camera(camera) @ turn.T @ BACKWARD
    width, height = camera.width, camera.height
    if camera.exif_orientation >= 5:
        width, height = height, width
    return {
        "w": width, "h": height, "fl_x": camera.focal_px, "fl_y": camera.focal_px, "cx": width / 2, "cy": height / 2,
        "k1": camera.k1, "k2": camera.k2, "p1": 0.0, "p2": 0.0, "transform_matrix": pose.tolist(),
    }  # fmt: skip


def fspy_parameters(camera: PhotoCamera, keep: Keep = "crop") -> dict[str, Any]:
    r"""The camera of the undistorted photo as fSpy exports it to JSON.

    fSpy's image plane reaches from -1 to 1 along the longer side L, so its relative focal length is :math:`2f/L` and
    the image centre is (0, 0). The vertical vanishing point of a level camera, at infinity, is written as null.

    Args:
        camera: camera of the photo.
        keep: how the photo is undistorted, as for :meth:`.PhotoCamera.undistort`.
    """
    width, height = camera.width, camera.height
    focal = straight_focal(width, height, camera.focal_px, camera.k1, camera.k2, keep)
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = _world_from_camera(camera) @ BACKWARD
    relative = 2 * focal / max(width, height)
    points = [_vanishing(axis, relative) for axis in world_from_camera[:3, :3]]
    return {
        "principalPoint": {"x": 0.0, "y": 0.0},
        "viewTransform": {"rows": world_from_camera.T.tolist()},
        "cameraTransform": {"rows": world_from_camera.tolist()},
        "horizontalFieldOfView": 2 * math.atan(width / 2 / focal),
        "verticalFieldOfView": 2 * math.atan(height / 2 / focal),
        "vanishingPoints": points,
        "vanishingPointAxes": ["xPositive", "yPositive", "zPositive"],
        "relativeFocalLength": relative,
        "imageWidth": width,
        "imageHeight": height,
    }


def ros_camera_info(camera: PhotoCamera) -> dict[str, Any]:
    """The camera as ROS's ``camera_calibration_parsers`` reads it; rectified images are those of ``undistort=crop``."""
    matrix, distortion = camera.opencv()
    straight = np.zeros((3, 4))
    straight[:, :3] = matrix
    focal = straight_focal(camera.width, camera.height, camera.focal_px, camera.k1, camera.k2, "crop")
    straight[0, 0] = straight[1, 1] = focal
    return {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": re.sub(r"[^A-Za-z0-9_]", "_", Path(camera.name).stem),
        "camera_matrix": _matrix(matrix),
        "distortion_model": "plumb_bob",
        "distortion_coefficients": _matrix(distortion[None]),
        "rectification_matrix": _matrix(np.eye(3)),
        "projection_matrix": _matrix(straight),
    }


def kalibr_camchain(camera: PhotoCamera) -> dict[str, Any]:
    """The camera as a Kalibr ``camchain.yaml`` of one camera."""
    matrix, (k1, k2, *tangential, _) = camera.opencv()
    fx, fy, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return {
        "cam0": {
            "cam_overlaps": [],
            "camera_model": "pinhole",
            "distortion_coeffs": [float(each) for each in (k1, k2, *tangential)],
            "distortion_model": "radtan",
            "intrinsics": [fx, fy, cx, cy],
            "resolution": [camera.width, camera.height],
            "rostopic": "/cam0/image_raw",
        }
    }


def check_exports(exports: Sequence[Export], undistort: Undistort) -> None:
    """Raise a ``UserError`` if an export needs undistorted photos and none are written."""
    if "fspy" in exports and undistort == "none":
        raise UserError(
            "exports=fspy: fSpy has no distortion (k1, k2), so it needs the undistorted photos that undistort=none "
            "leaves out",
            "Choose undistort=crop or undistort=all, or leave fspy out.",
        )


def write_exports(
    cameras: Sequence[PhotoCamera],
    undistorted: Sequence[Path],
    output: Path,
    exports: Sequence[Export],
    keep: Keep = "crop",
) -> list[Path]:
    """Write the cameras of photos for other programs.

    ``transforms.json`` has all photos. Each photo gets ``<photo>_fspy.json`` and ``<photo>.fspy`` (the same camera with
    the undistorted photo, which the importer of Blender reads; fSpy itself needs its lines too), ``<photo>_ros.yaml``
    and ``<photo>_camchain.yaml``.

    Args:
        cameras: cameras of files.
        undistorted: the undistorted copy of each photo; needed by fSpy alone.
        output: folder to write into; created if needed.
        exports: which formats.
        keep: how the copies were undistorted.

    Raises:
        ArgumentError: there is no such format.
        UserError: a camera cannot be expressed in a format, the disk is full, or the folder cannot be written to.

    Example:
        >>> camera = sextant.PhotoCalibrator.load().calibrate("photo.jpg")  # doctest: +SKIP
        >>> write_exports([camera], [], Path("out"), ["ros", "kalibr"])  # doctest: +SKIP
        [PosixPath('out/photo_ros.yaml'), PosixPath('out/photo_camchain.yaml')]
    """
    if unknown := [name for name in exports if name not in EXPORTS]:
        raise ArgumentError(f"exports: {unknown[0]!r} is none of {', '.join(EXPORTS)}")
    written = []
    for name, content in _contents(cameras, undistorted, output, exports, keep):
        with telling_write_errors(output):
            write_atomically(output / name, lambda file, content=content: file.write(content))  # type: ignore[misc]
        written.append(output / name)
    return written


def photo_stems(cameras: Sequence[PhotoCamera]) -> list[str]:
    """The beginning of the names of each photo's files, which no file of another photo or of all has."""
    return file_stems([Path(camera.name) for camera in cameras], COLLECTED, "_fspy")


def _contents(
    cameras: Sequence[PhotoCamera], undistorted: Sequence[Path], output: Path, exports: Sequence[Export], keep: Keep
) -> Iterator[tuple[str, bytes]]:
    """Names and contents of the files, one at a time."""
    stems = photo_stems(cameras)
    if "nerfstudio" in exports:
        frames = [
            {"file_path": Path(os.path.relpath(camera.name, output)).as_posix(), **nerfstudio_frame(camera)}
            for camera in cameras
        ]
        yield "transforms.json", json_bytes({"camera_model": "OPENCV", "sextant": UNKNOWN, "frames": frames})
    if "fspy" in exports:
        for camera, stem, photo in zip(cameras, stems, undistorted, strict=True):
            parameters = fspy_parameters(camera, keep)
            yield f"{stem}_fspy.json", json_bytes(parameters)
            yield f"{stem}.fspy", fspy_project(parameters, photo.read_bytes())
    for camera, stem in zip(cameras, stems, strict=True):
        if "ros" in exports:
            yield f"{stem}_ros.yaml", _yaml_bytes(ros_camera_info(camera))
        if "kalibr" in exports:
            yield f"{stem}_camchain.yaml", _yaml_bytes(kalibr_camchain(camera))


def fspy_project(parameters: dict[str, Any], photo: bytes) -> bytes:
    """A project of fSpy that its importer for Blender reads: the camera, and the photo as the background."""
    state = json_bytes(
        {"cameraParameters": parameters, "calibrationSettingsBase": {"referenceDistanceUnit": "No unit"}}
    )
    return struct.pack("<4I", *PROJECT, len(state), len(photo)) + state + photo


def _world_from_camera(camera: PhotoCamera) -> Float64[ndarray, "3 3"]:
    tilt, roll = (torch.tensor(math.radians(a), dtype=torch.float64) for a in (camera.tilt_deg, camera.roll_deg))
    return np.asarray(Z_UP @ rotation_from_tilt_roll(tilt, roll).numpy())


def _vanishing(axis: Float64[ndarray, "3"], relative: float) -> dict[str, float]:
    """The image of a direction of the world; its row of ``world_from_camera`` is the direction in the camera."""
    x, y, backward = axis.tolist()
    return (
        {"x": -relative * x / backward, "y": -relative * y / backward} if backward else {"x": math.inf, "y": math.inf}
    )


def _matrix(values: Float64[ndarray, "r c"]) -> dict[str, Any]:
    return {"rows": values.shape[0], "cols": values.shape[1], "data": values.ravel().tolist()}


def _yaml_bytes(value: dict[str, Any]) -> bytes:
    import yaml

    text: str = yaml.safe_dump(value, sort_keys=False, default_flow_style=None, width=10_000)
    return text.encode()
