"""What is known of a photo's camera while it is put together."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from torch import Tensor

from sextant.data.photos import NetworkView, Photo
from sextant.geometry import CameraParameters, K2Family, k2_of_k1

LEVELS = {"68": (0.68, 1.0), "95": (0.95, 1.96)}  # name: share of photos, and multiple of a normal standard error
VERDICTS = ("good", "weak", "not trustworthy")


@dataclass
class Finding:
    """A photo's camera while it is put together. Focal length and k1_hat are in heights of the part that was seen.

    Attributes:
        path: of the photo.
        photo: as read, its picture dropped.
        view: the part that the network saw, its picture dropped.
        camera: tilt, roll, focal and k1, float64 scalars.
        half: by level, half the widths of the intervals of tilt, roll, vfov and k1_hat.
        doubts: what speaks against it, each with the verdict it allows at best (an index of ``VERDICTS``).
        basis: what the intervals rest on.
    """

    path: Path
    photo: Photo
    view: NetworkView
    camera: CameraParameters
    half: dict[str, np.ndarray]
    family: K2Family
    doubts: list[tuple[int, str]] = field(default_factory=list)
    basis: str = "conformal"

    @property
    def k2(self) -> Tensor:
        """The second coefficient."""
        return k2_of_k1(self.camera.k1, self.family)

    @property
    def focal_px(self) -> float:
        """Pixels of the upright original."""
        return float(self.camera.focal) * self.view.height

    @property
    def side(self) -> int:
        """The longer side of the original: the unit in which photos of one camera, upright or not, are compared."""
        return max(self.photo.width, self.photo.height)
