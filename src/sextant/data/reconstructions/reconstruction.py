"""Posed images, from whichever program."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial.transform import Rotation

from sextant.data.image_files import natural_key
from sextant.data.name_matching import NameMatches, match_names
from sextant.data.positions import too_far
from sextant.errors import UserError, problem_list
from sextant.tables import counted

#: numbers in files are rounded: largest difference of a matrix from a rotation
ROTATION_TOLERANCE = 1e-2


@dataclass(frozen=True)
class Lens:
    """The lens that a file gives for an image.

    Attributes:
        model: name of the camera model, as the program writes it.
        width, height: of the images, pixels; 0 if the file does not give them.
        focal_px: focal length in pixels, the first if there are two; None if the file gives none.
        opencv: fx, fy, cx, cy, k1, k2, p1, p2 of OpenCV, whose first pixel has its centre at (0, 0); None if the model
            is another one or incomplete.
    """

    model: str
    width: int
    height: int
    focal_px: float | None
    opencv: tuple[float, ...] | None = field(default=None, compare=False)


@dataclass(frozen=True)
class PosedImage:
    """One image of a reconstruction.

    Attributes:
        name: as written in the file.
        world_from_camera: x right, y down, z forward.
        lens: None if the file gives none.
    """

    name: str
    world_from_camera: Float64[ndarray, "4 4"]
    lens: Lens | None = None


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """Posed images in the natural order of their names.

    Attributes:
        images: each with its pose and its lens.
        remarks: remarks on the file for the user.
    """

    images: tuple[PosedImage, ...]
    remarks: tuple[str, ...] = ()

    @property
    def names(self) -> list[str]:
        """The names of the images."""
        return [image.name for image in self.images]

    @property
    def poses(self) -> Float64[ndarray, "n 4 4"]:
        """``world_from_camera`` of all images."""
        return np.stack([image.world_from_camera for image in self.images])

    def match(self, files: Sequence[str]) -> NameMatches:
        """The image that each file is, by :func:`~sextant.data.name_matching.match_names`."""
        return match_names(files, self.names)


def reconstruction_of(
    path: Path, found: Sequence[PosedImage | str], remarks: Sequence[str] = (), fix: str = ""
) -> Reconstruction:
    """The reconstruction of a file's images, in order.

    Args:
        path: the file.
        found: its images; of one that cannot be used, the reason.
        remarks: remarks on the file for the user.
        fix: what to do if an image cannot be used.

    Raises:
        UserError: an image cannot be used, there are none, two have the same name, or one is implausibly far away.
    """
    problems = [each for each in found if isinstance(each, str)]
    if problems:
        raise unusable(path, problems, fix)
    images = sorted((each for each in found if isinstance(each, PosedImage)), key=lambda image: natural_key(image.name))
    if not images:
        raise UserError(f"{path}: it has no posed image", "Was the reconstruction successful? Export it again.")
    twice = [one.name for one, other in pairwise(images) if one.name == other.name]
    if twice:
        raise UserError(
            f"{path}: {counted(len(twice), 'image has', 'images have')} two poses\n{problem_list(twice)}",
            "Export it again.",
        )
    far = [f"{each.name}: {why}" for each in images if (why := too_far(each.world_from_camera[:3, 3].tolist()))]
    if far:
        raise unusable(path, far, "Correct these images, or remove them.")
    return Reconstruction(tuple(images), tuple(remarks))


def inverted(rotation: Float64[ndarray, "3 3"], translation: Float64[ndarray, "3"]) -> Float64[ndarray, "4 4"]:
    """``world_from_camera`` of ``x_camera = R x_world + t``."""
    pose = np.eye(4)
    pose[:3, :3] = rotation.T
    pose[:3, 3] = -rotation.T @ translation
    return pose


def rotation_of(quaternion: Float64[ndarray, "4"]) -> Float64[ndarray, "3 3"] | None:
    """The rotation of the quaternion (w, x, y, z), or None if its norm is not 1."""
    length = math.hypot(*quaternion.tolist())
    if not abs(length - 1) <= ROTATION_TOLERANCE:
        return None
    w, *xyz = quaternion.tolist()
    return np.asarray(Rotation.from_quat([*xyz, w]).as_matrix())


def finite(value: Any, *shape: int) -> Float64[ndarray, "..."] | None:
    """``value`` as finite numbers of a given shape, or None if it is anything else."""
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    return array if array.shape == shape and bool(np.isfinite(array).all()) else None


def unusable(path: Path, problems: Sequence[str], what: str) -> UserError:
    """The error for a file with images that cannot be used."""
    return UserError(f"{path}: {counted(len(problems), 'image')} cannot be used\n{problem_list(problems)}", what)
