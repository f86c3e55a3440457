"""The one camera of many images: its parameters, how it was held, and the straight camera that two of them share."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from sextant.chapters.calibration.one_camera import OneCamera
from sextant.chapters.calibration.photo_camera import PhotoCamera
from sextant.data.photos import Pinhole, straight_focal, through_pinhole
from sextant.errors import ArgumentError

#: how a camera was held: the same in all images (mounted), different in each (by hand), or assumed to be level
Held = Literal["mounted", "by_hand", "level"]


@dataclass(frozen=True, eq=False)
class SharedCamera:
    """One camera and lens setting.

    Attributes:
        width, height: size of the image that was calibrated first, pixels.
        focal: focal length in longer sides of an image.
        k1, k2: radial distortion.
        tilts, rolls: of each image, radians; one for all if the camera was mounted.
        row: the fusion over the photos with its intervals, as plain values; empty for a camera that was given.

    Example:
        >>> known = SharedCamera(320, 240, 0.8, -0.2, 0.03, np.zeros(1), np.zeros(1), {})
        >>> known.focal_px
        256.0
    """

    width: int
    height: int
    focal: float
    k1: float
    k2: float
    tilts: Float64[ndarray, "n"]
    rolls: Float64[ndarray, "n"]
    row: dict[str, Any]

    @classmethod
    def of(cls, one: OneCamera, held: Held = "mounted") -> "SharedCamera":
        """The camera of photos that were calibrated together.

        For a mounted camera, tilt and roll are the medians over the photos.

        Raises:
            UserError: ``held`` is none of the three.
        """
        check_held(held)
        kept = [camera for camera, used in zip(one.cameras, one.fusion.kept, strict=True) if used]
        first = kept[0]
        found = np.radians([(photo.tilt_deg, photo.roll_deg) for photo in kept])
        median = np.zeros(2) if held == "level" else np.median(found, axis=0)
        each = np.array([
            np.radians([photo.tilt_deg, photo.roll_deg]) if isinstance(photo, PhotoCamera) and held == "by_hand"
            else median for photo in one.photos
        ])  # fmt: skip
        tilts, rolls = each.T if held == "by_hand" else median[:, None]
        row = one.row() | {
            "camera": first.row(),
            "held": held,
            "tilt_deg": float(np.degrees(np.median(tilts))),
            "roll_deg": float(np.degrees(np.median(rolls))),
            "tilt_spread_deg": float(np.degrees(found[:, 0]).std()),
            "roll_spread_deg": float(np.degrees(found[:, 1]).std()),
        }
        return cls(first.width, first.height, one.focal_of_longer_side, first.k1, first.k2, tilts, rolls, row)

    @property
    def focal_px(self) -> float:
        """Focal length in pixels of an image of :attr:`width` by :attr:`height`."""
        return self.focal * max(self.width, self.height)

    @property
    def reach(self) -> tuple[float, float]:
        """Half the width and height, in focal lengths, of the largest straight image of its shape without borders."""
        straight = straight_focal(self.width, self.height, self.focal_px, self.k1, self.k2, "crop")
        return self.width / 2 / straight, self.height / 2 / straight

    def straighten(
        self, image: UInt8[ndarray, "h w 3"], view: Pinhole, number: int
    ) -> tuple[UInt8[ndarray, "vh vw 3"], float]:
        """The ``number``-th image as ``view`` would have taken it, and the share of the view that it does not show."""
        held = min(number, len(self.tilts) - 1)
        return through_pinhole(
            image, view, focal=self.focal * max(image.shape[:2]), k1=self.k1, k2=self.k2,
            tilt=float(self.tilts[held]), roll=float(self.rolls[held]),
        )  # fmt: skip


def check_held(held: str) -> None:
    """Check that ``held`` is a known way to hold a camera.

    Raises:
        UserError: ``held`` is none of the three.
    """
    if held not in get_args(Held):
        raise ArgumentError(f"held={held} must be one of {', '.join(get_args(Held))}", "held=mounted")


def check_view(rows: int, vfov_deg: float | None) -> None:
    """Check the arguments of a view that do not depend on the cameras.

    Raises:
        UserError: the number of rows or the field of view is out of range.
    """
    if not 8 <= rows <= 1080:
        raise ArgumentError(f"rows={rows} must be from 8 to 1080", "rows=120")
    if vfov_deg is not None and not 0 < vfov_deg < 170:
        raise ArgumentError(f"vfov_deg={vfov_deg:g} must be between 0 and 170 degrees", "vfov_deg=55")


def shared_view(cameras: Sequence[SharedCamera], rows: int = 120, vfov_deg: float | None = None) -> Pinhole:
    """The largest straight view that all cameras cover: without roll, its tilt midway between theirs.

    Args:
        cameras: cameras and how they were held; the median tilt of each counts.
        rows: rows of the view's images; columns follow from its shape.
        vfov_deg: vertical field of view in degrees, in place of the largest.

    Raises:
        UserError: the number of rows or the field of view is out of range, or the cameras are tilted so differently
            that they have no view in common.
    """
    check_view(rows, vfov_deg)
    tilts = [float(np.median(camera.tilts)) for camera in cameras]
    tilt = (min(tilts) + max(tilts)) / 2
    across = min(camera.reach[0] for camera in cameras)
    halves = [math.atan(camera.reach[1]) - abs(each - tilt) for camera, each in zip(cameras, tilts, strict=True)]
    half = min(halves) if vfov_deg is None else math.radians(vfov_deg) / 2
    if half <= 0:
        raise ArgumentError(
            f"the cameras are tilted by {math.degrees(min(tilts)):.0f} and {math.degrees(max(tilts)):.0f} degrees: "
            "they have no view in common",
            "Give vfov_deg, or ignore how they were held: held=level",
        )
    columns = 2 * round(rows * across / math.tan(half) / 2)
    return Pinhole(max(8, min(columns, 4 * rows)), rows, rows / 2 / math.tan(half), tilt)
