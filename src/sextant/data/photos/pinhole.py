r"""Re-projection of a photo to a camera without distortion or roll, at a chosen tilt, from the same place.

The ray of a pixel of that picture is, with x right, y down and z forward in the chosen camera's frame,
:math:`d = ((c - W/2)/F, (r - H/2)/F, 1)`; the photo's camera sees it in the direction
:math:`R_z(\psi)^\top R_x(\theta)^\top R_x(\theta_0)\, d`, with tilt θ and roll ψ of the photo and tilt :math:`\theta_0`
of the picture, at a pixel that the distortion gives without any inversion. Pictures by two cameras, however they were
held, thus become pictures by one: they then differ only in where and when they were taken.
"""

import math
from dataclasses import asdict, dataclass

import numpy as np
import torch
from jaxtyping import Float64, UInt8
from numpy import ndarray

from sextant.errors import ArgumentError
from sextant.geometry import max_radius, rotation_from_tilt_roll


@dataclass(frozen=True)
class Pinhole:
    """A camera without distortion or roll.

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
    """Where the rays of a view are seen in a photo, in focal lengths from its centre, and whether they are seen."""
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
