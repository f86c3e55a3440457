"""Photos without the distortion of their lens, levelled, or as another camera would take them."""

import math
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float64, UInt8
from numpy import ndarray

from sextant.errors import ArgumentError
from sextant.geometry import max_radius, perspective_project, rotation_from_tilt_roll, undistort_radius

STRIP = 256  # rows undistorted at a time
Keep = Literal["crop", "all"]


def undistort_photo(
    image: UInt8[ndarray, "h w 3"], focal: float, k1: float, k2: float, keep: Keep = "crop"
) -> tuple[UInt8[ndarray, "h w 3"], float]:
    """Undistort a photo, at the same size; also returns the focal length of the result in pixels.

    Undistortion needs no inversion: a pixel at the normalised point p of the undistorted picture is imaged at
    :math:`f (1 + k_1 |p|^2 + k_2 |p|^4) p` from the centre of the photo.

    Args:
        image: the photo.
        focal: its focal length in pixels of ``image``.
        k1: first coefficient of its distortion.
        k2: second coefficient.
        keep: ``crop`` crops so that no empty border is left; ``all`` keeps every pixel, with black borders (as far as
            the lens model reaches: no ray is imaged beyond its fold).
    """
    import cv2

    height, width = image.shape[:2]
    straight = straight_focal(width, height, focal, k1, k2, keep)
    fold = float(max_radius(torch.tensor(k1, dtype=torch.float64), torch.tensor(k2, dtype=torch.float64)))
    border = cv2.BORDER_REPLICATE if keep == "crop" else cv2.BORDER_CONSTANT
    result = np.empty_like(image)
    x = (np.arange(width) + 0.5 - width / 2) / straight
    for start in range(0, height, STRIP):
        y = (np.arange(start, min(start + STRIP, height)) + 0.5 - height / 2)[:, None] / straight
        square = x * x + y * y
        factor = focal * (1 + square * (k1 + k2 * square))
        if square.max() > fold * fold:
            factor = np.where(square > fold * fold, np.inf, factor)
        columns = (factor * x + (width / 2 - 0.5)).astype(np.float32)  # OpenCV's pixels have their centres at integers
        rows = (factor * y + (height / 2 - 0.5)).astype(np.float32)
        if not np.isfinite(factor).all():
            columns, rows = (np.where(np.isfinite(factor), m, np.float32(-10)) for m in (columns, rows))
        result[start : start + STRIP] = cv2.remap(image, columns, rows, cv2.INTER_CUBIC, borderMode=border)
    return result, straight


def straight_focal(width: int, height: int, focal: float, k1: float, k2: float, keep: Keep) -> float:
    """Focal length (pixels) of the undistorted picture of the same size that has no borders, or keeps everything.

    Towards a point of the photo's edge at R pixels from the centre, the lens covers radii up to
    ``r = undistort(R / f)``, and an undistorted picture of the same size with focal length g up to ``R / g``. So g
    is the largest (``crop``) or smallest (``all``) of ``R / r`` along the edge.
    """
    radius = torch.linspace(min(width, height) / 2, math.hypot(width, height) / 2, 4096, dtype=torch.float64)
    coefficients = (torch.tensor(value, dtype=torch.float64) for value in (k1, k2))
    candidates = radius / undistort_radius(radius / focal, *coefficients)
    return float(candidates.max() if keep == "crop" else candidates.min())


@dataclass(frozen=True)
class Pinhole:
    r"""A camera without distortion or roll.

    The ray of a pixel of that picture is, with x right, y down and z forward in the chosen camera's frame, :math:`d =
    ((c - W/2)/F, (r - H/2)/F, 1)`; in the frame of the photo's camera it is :math:`R_z(\psi)^\top R_x(\theta)^\top
    R_x(\theta_0)\, d`, with tilt θ and roll ψ of the photo and tilt :math:`\theta_0` of the picture, at a pixel that
    the distortion gives without any inversion. Pictures by two cameras in any orientation thus become pictures by one:
    they then differ only in where and when they were taken.

    Args:
        width, height: of its pictures, pixels.
        focal: focal length, pixels.
        tilt: of the camera, radians, positive upward.

    Raises:
        UserError: a value is out of range.

    Example:
        >>> round(Pinhole(160, 120, 120.0).vfov_deg, 1)
        53.1
    """

    width: int
    height: int
    focal: float
    tilt: float = 0.0

    def __post_init__(self) -> None:
        if min(self.width, self.height) < 1 or not 0 < self.focal < math.inf or not abs(self.tilt) < math.pi / 2:
            raise ArgumentError(f"{self}: sides and focal length are above 0, and the tilt below 90 degrees", of=self)

    @property
    def vfov_deg(self) -> float:
        """Vertical field of view, degrees."""
        return math.degrees(2 * math.atan(self.height / 2 / self.focal))

    def facts(self) -> dict[str, float]:
        """The arguments as plain values."""
        return asdict(self)


def through_pinhole(
    image: UInt8[ndarray, "h w 3"],
    view: Pinhole,
    *,
    focal: float,
    k1: float = 0.0,
    k2: float = 0.0,
    tilt: float = 0.0,
    roll: float = 0.0,
) -> tuple[UInt8[ndarray, "vh vw 3"], float]:
    """The picture that another camera would have taken, and the share of it that the photo does not show.

    What the photo does not show takes the colour of its nearest edge. A photo of higher resolution than the picture is
    first averaged over areas to avoid aliasing.

    Args:
        image: the photo.
        view: the other camera.
        focal: of the photo, in its pixels.
        k1, k2: its distortion.
        tilt, roll: of its camera, radians.
    """
    import cv2

    finer = focal / view.focal
    if finer > 1:
        rows, columns = image.shape[:2]
        size = (max(1, round(columns / finer)), max(1, round(rows / finer)))
        image, focal = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA)), focal * size[1] / rows
    height, width = image.shape[:2]
    points, sighted = _seen_at(view, k1, k2, tilt, roll)
    columns_at, rows_at = points[..., 0] * focal + width / 2, points[..., 1] * focal + height / 2
    inside = sighted & (columns_at >= 0) & (columns_at <= width) & (rows_at >= 0) & (rows_at <= height)
    x, y = ((each - 0.5).clip(-1.0, 32766.0).astype(np.float32) for each in (columns_at, rows_at))  # OpenCV's pixels
    picture = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(picture), 1 - float(inside.mean())


def _seen_at(
    view: Pinhole, k1: float, k2: float, tilt: float, roll: float
) -> tuple[Float64[ndarray, "h w 2"], Float64[ndarray, "h w"]]:
    """Image points of a view's rays in a photo, in focal lengths from its centre, and whether they lie inside it."""
    x = (np.arange(view.width) + 0.5 - view.width / 2) / view.focal
    y = (np.arange(view.height) + 0.5 - view.height / 2) / view.focal
    rays = np.stack([*np.meshgrid(x, y), np.ones((view.height, view.width))], axis=-1)
    held, wanted = (
        rotation_from_tilt_roll(*torch.tensor(angles, dtype=torch.float64)).numpy()
        for angles in ((tilt, roll), (view.tilt, 0.0))
    )
    rays = rays @ (held.T @ wanted).T
    ahead = rays[..., 2] > 1e-6
    ideal = rays[..., :2] / np.where(ahead, rays[..., 2], 1.0)[..., None]
    square = (ideal**2).sum(-1)
    fold = float(max_radius(torch.tensor(k1, dtype=torch.float64), torch.tensor(k2, dtype=torch.float64)))
    sighted = ahead & (square <= fold * fold)
    kept = np.where(sighted, square, np.minimum(square, min(fold * fold, 1e6)))
    return ideal * (1 + kept * (k1 + k2 * kept))[..., None], sighted


#: tilt (radians) beyond which a level picture would be grossly stretched
STEEPEST = math.radians(30)


def level_photo(
    image: UInt8[ndarray, "h w 3"], tilt: float, roll: float, focal: float, k1: float, k2: float
) -> tuple[UInt8[ndarray, "h w 4"], bool]:
    r"""Remove roll and distortion from a picture of the same size, and tilt up to :data:`STEEPEST`.

    A pixel of the level picture at the normalised point p has the direction :math:`R^\top (p, 1)` in the camera,
    with :math:`R = R_x(\theta) R_z(\psi)` of :func:`~sextant.geometry.rotation_from_tilt_roll`; its colour is that of
    the photo where the lens covers that direction.

    Without tilt, vertical lines are vertical in the picture too. The photo's centre stays in the centre, as with a
    shift lens.

    Args:
        image: the photo.
        tilt: of its camera, radians, positive upward.
        roll: of its camera, radians.
        focal: its focal length in pixels of ``image``.
        k1: first coefficient of its distortion.
        k2: second coefficient.

    Returns:
        RGB and opacity, 0 where the photo shows nothing; and whether tilt was removed.
    """
    import cv2

    height, width = image.shape[:2]
    undone = abs(tilt) <= STEEPEST
    leant = tilt if undone else 0.0
    rotation = rotation_from_tilt_roll(*torch.tensor([leant, roll], dtype=torch.float64))
    straight = focal * math.cos(leant)  # same width as the photo, in its middle
    x = (torch.arange(width, dtype=torch.float64) + 0.5 - width / 2) / straight
    y = (torch.arange(height, dtype=torch.float64) + 0.5 - height / 2) / straight - math.tan(leant)
    down, across = torch.meshgrid(y, x, indexing="ij")
    lens = torch.tensor([focal, k1, k2], dtype=torch.float64)
    points, seen = perspective_project(
        torch.stack([across, down, torch.ones_like(x)[None].expand_as(down)], -1) @ rotation, *lens
    )
    points = torch.where(seen[..., None], points + torch.tensor([width, height]) / 2 - 0.5, -10)
    opaque = np.dstack([image, np.full((height, width), 255, np.uint8)])
    columns, rows = points.numpy().astype(np.float32).transpose(2, 0, 1)
    return cv2.remap(opaque, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT), undone
