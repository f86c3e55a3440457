"""Poses and cameras of photos as a user gives them, checked."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.applications.pixels import detached
from sextant.baselines.calibration import FOCAL_HEIGHTS
from sextant.correspondence import LocalFeatureExtractor, LocalFeatures, Pinhole, focal_length_of
from sextant.data.positions import too_far
from sextant.errors import ArgumentError, UserError, problem_list, shown
from sextant.tables import counted

#: points of a map: fewer inliers than this do not reach the limit of false alarms, so that nothing would be located
LEAST_POINTS = 30
#: largest distance of an image's centre from its principal point, in focal lengths: 63 degrees off the axis. Set by
#: hand; a crop of a perspective photo hardly lies further out
ASIDE = 2.0
#: largest deviation of a rotation from an orthonormal matrix
ROTATION_TOLERANCE = 1e-3


@runtime_checkable
class CameraPrior(Protocol):
    """A camera whose focal length is known roughly; the answer of ``PhotoCalibrator`` is one."""

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        ...

    @property
    def focal_sigma(self) -> float | None:
        """Its standard deviation relative to it; None: it is unknown."""
        ...


def checked_poses(poses: Any, images: int, least: int = 2) -> Float64[ndarray, "n 4 4"]:
    """Rigid motions, one for each image.

    Raises:
        ArgumentError: their number or shape is another, there are fewer images than ``least``, or one is not rigid or
            implausibly far away.
    """
    try:
        matrices = np.asarray(detached(poses), np.float64)
    except (TypeError, ValueError, RuntimeError):
        matrices = np.empty(0)
    if matrices.ndim != 3 or matrices.shape[1:] != (4, 4) or len(matrices) != images:
        raise ArgumentError(
            f"poses have the shape {matrices.shape} for {counted(images, 'image')}; they must be {images} x 4 x 4",
            "world_from_camera of each image: x right, y down, z forward.",
        )
    if images < least:
        raise ArgumentError(
            f"{counted(images, 'image makes', 'images make')} no map: points need two images at least",
            "Give more images.",
        )
    turn = matrices[:, :3, :3]
    wrong = np.abs(turn @ turn.transpose(0, 2, 1) - np.eye(3)).max((1, 2)) > ROTATION_TOLERANCE
    wrong |= (np.linalg.det(turn) < 0) | ~np.isfinite(matrices).all((1, 2))
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        mirrored = np.linalg.det(turn[first]) < 0
        raise ArgumentError(
            f"pose {first} of {wrong.sum()} such poses is no rigid motion"
            + (": its axes are mirrored (determinant -1)" if mirrored else ""),
            "The upper left 3 x 3 must be a rotation: x right, y down, z forward.",
        )
    for number, position in enumerate(matrices[:, :3, 3].tolist()):
        if far := too_far(position):
            raise ArgumentError(f"pose {number}: {far}", "Correct this pose, or leave out its image.")
    return matrices


def pinhole_of(camera: Any, features: LocalFeatures) -> Pinhole:
    """The camera of an image with these features.

    Raises:
        ArgumentError: it is no camera, or of another image: its size differs, its focal length is outside of the range
            of calibration, or the image's centre is seen further aside than :data:`ASIDE`.
    """
    if isinstance(camera, Pinhole):
        if (camera.width, camera.height) != (features.width, features.height):
            raise ArgumentError(
                f"a camera of {camera.width}x{camera.height} pixels for an image of {features.width}x{features.height}",
                "Scale the camera with the image.",
            )
        found = camera
    else:
        try:
            fx, fy, cx, cy = (float(value) for value in camera)
        except (TypeError, ValueError):
            raise ArgumentError(
                f"camera={shown(camera)} must be (fx, fy, cx, cy) in pixels, a Pinhole, or have focal_px and "
                "focal_sigma"
            ) from None
        found = Pinhole(features.width, features.height, fx, fy, cx, cy)
    if why := _impossible(found):
        raise ArgumentError(f"camera={why[0]}", why[1])
    return found


def check_cameras(cameras: Sequence[Pinhole], names: Sequence[str], source: Path | str) -> None:
    """Check the cameras that ``source`` has of these images.

    Raises:
        UserError: one is no camera of its image, as for :func:`pinhole_of`; the message names the image.
    """
    both = zip(names, map(_impossible, cameras), strict=True)
    if wrong := [(f"{name}: fx,fy,cx,cy={why[0]}", why[1]) for name, why in both if why]:
        listed = problem_list([problem for problem, _ in wrong])
        raise UserError(f"{source}: {counted(len(wrong), 'camera')} cannot be used\n{listed}", wrong[0][1])


def _impossible(camera: Pinhole) -> tuple[str, str] | None:
    """Why a camera cannot be that of an image of its size, and what to do."""
    width, height = camera.width, camera.height
    low, high = (height * end for end in FOCAL_HEIGHTS)
    told = f"{camera.fx:g},{camera.fy:g},{camera.cx:g},{camera.cy:g}"
    if not (low <= camera.fx <= high and low <= camera.fy <= high):
        return (
            f"{told}: focal lengths of an image {height} pixels high must be from {low:.0f} to {high:.0f} pixels (of "
            "the image, not millimetres)",
            "Give fx, fy, cx, cy in pixels of this image, or no camera.",
        )
    aside = math.hypot((width / 2 - camera.cx) / camera.fx, (height / 2 - camera.cy) / camera.fy)
    if not aside <= ASIDE:
        return (
            f"{told}: the principal point is {aside:.1f} focal lengths from the centre of an image of {width}x{height} "
            "pixels",
            "Give fx, fy, cx, cy in pixels of this image: scale them if it was resized.",
        )
    return None


def cameras_of(
    cameras: Any, found: Sequence[LocalFeatures], poses: ndarray, features: LocalFeatureExtractor
) -> list[Pinhole]:
    """The camera of each image; without any, one focal length relative to the longer side is estimated.

    Raises:
        UserError: numbers differ, one is no camera, or nothing determines a focal length.
    """
    if cameras is None:
        focal = focal_length_of(found, poses, features.match)
        if focal is None:
            raise UserError(*without_points(found))
        return [Pinhole.centred(each.width, each.height, focal * max(each.width, each.height)) for each in found]
    try:
        single = isinstance(cameras, Pinhole) or (
            np.shape(cameras) == (4,) and not isinstance(cameras[0], Pinhole) and np.ndim(cameras[0]) == 0
        )
        number = 1 if single else len(cameras)
    except TypeError:
        raise ArgumentError(
            f"cameras={shown(cameras)} must be (fx, fy, cx, cy), a Pinhole, or one of each image"
        ) from None
    if single:
        return [pinhole_of(cameras, each) for each in found]
    if number != len(found):
        raise ArgumentError(
            f"{counted(number, 'camera')} for {counted(len(found), 'image')}: give one, or one for each image"
        )
    return [pinhole_of(camera, each) for camera, each in zip(cameras, found, strict=True)]


def scaled(camera: Pinhole, features: LocalFeatures) -> Pinhole:
    """The same camera for an image of another size, whose first pixel has its centre at (0, 0)."""
    scale = features.width / camera.width
    if abs(camera.height * scale - features.height) > 1:
        raise ArgumentError(
            f"an image of {features.width}x{features.height} pixels is not of the map's first camera, whose images "
            f"have {camera.width}x{camera.height}",
            "Give its camera.",
        )
    cx, cy = ((value + 0.5) * scale - 0.5 for value in (camera.cx, camera.cy))
    return Pinhole(features.width, features.height, camera.fx * scale, camera.fy * scale, cx, cy)


def prior_of(camera: Any, features: LocalFeatures, similar: Pinhole) -> tuple[Pinhole, float | None]:
    """A camera, and the relative standard deviation of its focal length; None: unknown.

    The principal point of an unknown camera is that of the most similar image of the map if both have one size.
    """
    if camera is None and (similar.width, similar.height) == (features.width, features.height):
        return similar, None
    if camera is None:
        return Pinhole.centred(features.width, features.height, float(max(features.width, features.height))), None
    if isinstance(camera, CameraPrior):
        return Pinhole.centred(features.width, features.height, camera.focal_px), camera.focal_sigma
    return pinhole_of(camera, features), 0.0


def without_points(found: Sequence[LocalFeatures]) -> tuple[str, str]:
    """Why images make no map, and what to do."""
    few = sum(len(each) < 50 for each in found)
    if few > len(found) / 2:
        return (
            f"{few:,} of {counted(len(found), 'image')} {'has' if few == 1 else 'have'} fewer than 50 keypoints: "
            "blank walls or dark pictures make no map",
            "Give images with texture.",
        )
    return (
        f"fewer than {LEAST_POINTS} matches of the map's images agree with their poses",
        "Check that images overlap, that each pose belongs to its image, and the axes: world_from_camera, x right, "
        "y down, z forward (OpenGL and Blender have y up and z back; COLMAP's matrices are camera_from_world).",
    )
