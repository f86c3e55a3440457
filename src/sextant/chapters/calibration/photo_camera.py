"""The estimated camera of a photo, with its intervals and verdict."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import torch
from jaxtyping import Float64, Num
from numpy import ndarray
from PIL import Image

from sextant.data.photos import Keep, undistort_photo
from sextant.errors import UserError
from sextant.geometry import undistort_radius
from sextant.ranges import checked

if TYPE_CHECKING:
    from sextant.chapters.calibration.figures.overlay import CalibratedPhoto

Verdict = Literal["good", "weak", "not trustworthy"]
#: a file, an array, or a Pillow image
AnyPhoto = Path | str | ndarray | Image.Image


@dataclass(frozen=True)
class Intervals:
    """Intervals at one level, as (low, high).

    Attributes:
        tilt_deg, roll_deg: degrees.
        focal_px: pixels of the upright original; 0 or infinity at an end where it is unbounded.
        vfov_deg: nominal vertical field of view, degrees.
        k1: at the estimated focal length.
    """

    tilt_deg: tuple[float, float]
    roll_deg: tuple[float, float]
    focal_px: tuple[float, float]
    vfov_deg: tuple[float, float]
    k1: tuple[float, float]


@dataclass(frozen=True)
class PhotoCamera:
    """The camera of a photo. Pixels are those of the upright original, after EXIF orientation.

    Attributes:
        name: file of the photo; for an array its position, such as ``photos[3]``.
        width, height: size of the photo, pixels.
        exif_orientation: 1 to 8; 1 is upright.
        exif_focal_px: focal length from EXIF in pixels; None if it has none.
        tilt_deg: tilt of the camera in degrees, positive upwards.
        roll_deg: roll of the camera in degrees.
        focal_px: focal length in pixels.
        k1, k2: coefficients of the radial distortion ``1 + k1 r² + k2 r⁴``, r the tangent of the angle to the axis.
        interval_68, interval_95: intervals that cover the truth for 68 and 95 % of photos: for the network alone, of
            photos like its training images; for all evidence, on average over the calibration sets.
        intervals_by: how the intervals were obtained.
        verdict: how far the camera can be trusted.
        reasons: why the verdict is not better, or what else to know about the estimate.
        width_over_training_spread: half the 68 % intervals of tilt, roll, field of view and apparent distortion,
            divided by the same over all training cameras; empty for a network of others.
        seen: left, top, width and height of the part given to the network, pixels.
        probability_right: that tilt, roll and focal length are within 3°, 2° and 10 % of the truth, for the camera of
            one photo by itself from all evidence; otherwise None.
    """

    name: str
    width: int
    height: int
    exif_orientation: int
    exif_focal_px: float | None
    tilt_deg: float
    roll_deg: float
    focal_px: float
    k1: float
    k2: float
    interval_68: Intervals
    interval_95: Intervals
    intervals_by: str
    verdict: Verdict
    reasons: tuple[str, ...]
    width_over_training_spread: Mapping[str, float]
    seen: tuple[float, float, float, float]
    probability_right: float | None = None

    @property
    def vfov_deg(self) -> float:
        """Nominal vertical field of view ``2 atan(height / 2 f)``, degrees."""
        return math.degrees(2 * math.atan(self.height / 2 / self.focal_px))

    @property
    def focal_sigma(self) -> float | None:
        """Standard deviation of the focal length's logarithm, half its 68 % interval; None if that is unbounded."""
        low, high = self.interval_68.focal_px
        return math.log(high / low) / 2 if low > 0 and high < math.inf else None

    @property
    def true_fov_deg(self) -> tuple[float, float]:
        """Horizontal and vertical angle between the rays at the middles of opposite edges, degrees."""
        ends = torch.tensor([self.width, self.height], dtype=torch.float64) / 2 / self.focal_px
        k1, k2 = (torch.tensor(value, dtype=torch.float64) for value in (self.k1, self.k2))
        horizontal, vertical = torch.rad2deg(2 * torch.atan(undistort_radius(ends, k1, k2))).tolist()
        return horizontal, vertical

    def opencv(self) -> tuple[Float64[ndarray, "3 3"], Float64[ndarray, "5"]]:
        """Camera matrix and distortion coefficients (k1, k2, p1, p2, k3) in OpenCV's convention."""
        row = self.row()["opencv"]
        return np.array(row["matrix"], np.float64), np.array(row["distortion"], np.float64)

    def colmap(self) -> tuple[str, list[float]]:
        """COLMAP's camera model and its parameters: f, cx, cy, k1, k2."""
        return "RADIAL", [self.focal_px, self.width / 2, self.height / 2, self.k1, self.k2]

    @checked
    def undistort(self, image: AnyPhoto, keep: Keep = "crop") -> tuple[Num[ndarray, "h w *c"], float]:
        """The photo as a lens without distortion would have taken it, and the focal length of the result in its pixels.

        Args:
            image: the photo, in any form in which it may be calibrated; an array is upright, of any size and kind of
                numbers, which the result has too.
            keep: ``crop`` cuts off what would leave an empty border; ``all`` keeps every pixel.

        Raises:
            UserError: the image cannot be read, or does not have the photo's shape.
            ArgumentError: ``keep`` is another word.
        """
        pixels = _pixels(image, np.number)
        rows, columns = pixels.shape[:2]
        scale = rows / self.height
        if abs(columns - scale * self.width) > 1 + scale:
            raise UserError(
                f"the image has {columns}x{rows} pixels, but {self.name} has {self.width}x{self.height}",
                "Give the whole photo, turned upright; it may be scaled.",
            )
        return undistort_photo(pixels, self.focal_px * scale, self.k1, self.k2, keep)

    def drawn(self, image: AnyPhoto) -> "CalibratedPhoto":
        """The input of :func:`~.figures.overlay.calibration_overlay`; the image may be scaled."""
        from sextant.chapters.calibration.figures.overlay import CalibratedPhoto

        left, top, width, height = self.seen
        seen = (left / self.width, top / self.height, width / self.width, height / self.height)
        return CalibratedPhoto(
            _pixels(image), math.radians(self.tilt_deg), math.radians(self.roll_deg), self.focal_px / self.height,
            self.k1, self.k2, seen, self._caption(),
        )  # fmt: skip

    def _caption(self) -> list[str]:
        def half(ends: tuple[float, float], unit: str) -> str:
            width = (ends[1] - ends[0]) / 2
            return f"±{width:.2g}{unit}" if math.isfinite(width) else "±?"

        near = self.interval_68
        tilt, roll = half(near.tilt_deg, "°"), half(near.roll_deg, "°")
        return [
            f"{self.name.rpartition('/')[2]}: {self.verdict}",
            f"tilt {self.tilt_deg:+.1f}°{tilt}, roll {self.roll_deg:+.1f}°{roll}",
            f"field of view {self.vfov_deg:.1f}°{half(near.vfov_deg, '°')}, k1 {self.k1:+.3f}{half(near.k1, '')}",
        ]

    def row(self) -> dict[str, Any]:
        """Everything as plain numbers, with the conventions of other programs: the content of a JSON file."""
        focal, width, height = self.focal_px, self.width, self.height
        model, parameters = self.colmap()
        horizontal, vertical = self.true_fov_deg
        left, top, across, down = self.seen
        both = {"68": self.interval_68, "95": self.interval_95}
        return {
            "file": self.name,
            "width": width,
            "height": height,
            "exif_orientation": self.exif_orientation,
            "tilt_deg": self.tilt_deg,
            "roll_deg": self.roll_deg,
            "focal_px": focal,
            "vfov_deg": self.vfov_deg,
            "true_vfov_deg": vertical,
            "true_hfov_deg": horizontal,
            "k1": self.k1,
            "k2": self.k2,
            "k1_hat": self.k1 * (height / focal) ** 2,
            "intervals": {level: {key: list(ends) for key, ends in vars(of).items()} for level, of in both.items()},
            "intervals_by": self.intervals_by,
            "exif_focal_px": self.exif_focal_px,
            "confidence": {
                "verdict": self.verdict,
                "probability_right": self.probability_right,
                "width_over_training_spread": dict(self.width_over_training_spread),
                "reasons": list(self.reasons),
            },
            "opencv": {
                "matrix": [[focal, 0, width / 2 - 0.5], [0, focal, height / 2 - 0.5], [0, 0, 1]],
                "distortion": [self.k1, self.k2, 0, 0, 0],
            },
            "colmap": {"model": model, "parameters": parameters},
            "seen": {
                "left": left,
                "top": top,
                "width": across,
                "height": down,
                "share": across * down / (width * height),
            },
            "units": "pixels of the upright original (after EXIF orientation); tilt > 0 looks up; vfov_deg is nominal, "
            "2 atan(height / 2 f), true_* are with distortion; k1_hat is k1 / f² in heights of the photo; "
            "the interval of k1 is at this focal length",
        }


def _pixels(image: AnyPhoto, kind: type = np.uint8) -> Num[ndarray, "h w *c"]:
    """The photo's pixels; an array of this kind of numbers keeps them."""
    if isinstance(image, ndarray) and np.issubdtype(image.dtype, kind) and image.ndim in (2, 3) and image.size:
        return image
    from sextant.chapters.calibration.inference import given_photo

    return given_photo("the image", image, "Give its file.").image
