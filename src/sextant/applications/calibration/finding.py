"""What is known of a photo's camera while it is put together."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import torch
from jaxtyping import Float64
from numpy import ndarray
from torch import Tensor

from sextant.baselines.calibration import GravityBelief, LineEvidence
from sextant.data.photos import NetworkView, Photo
from sextant.geometry import CameraParameters, K2Family, focal_from_vfov, k2_of_k1, vfov_from_focal

LEVELS = {"68": (0.68, 1.0), "95": (0.95, 1.96)}  # name: share of photos, and multiple of a normal standard error


@dataclass(frozen=True, eq=False)
class Finding:
    """A photo's camera while it is put together. Focal length and k1_hat are in heights of the part that was seen.

    Attributes:
        name: of the photo.
        photo: as read, its picture dropped.
        view: the part that the network saw.
        camera: tilt, roll, focal and k1, float64 scalars.
        half: by level, half the widths of the intervals of tilt, roll, vfov (radians) and k1_hat.
        family: of the lens.
        doubts: what speaks against it, each with the verdict it allows at best: 0 good, 1 weak, 2 not trustworthy.
        basis: what the intervals rest on.
        lines: of the photo; None where they are not looked at.
        network: what the network alone says, where ``camera`` is by more than that.
        trusts_network: whether the network's word counted for ``camera``.
        strangeness: of the photo to the network.
        network_doubts: as ``doubts``, against what the network says alone.
        alone: half the widths of the intervals by this photo alone, where ``half`` is fused with others.
        gravity: that counts for ``camera`` beside the picture.
    """

    name: str
    photo: Photo
    view: NetworkView
    camera: CameraParameters
    half: Mapping[str, Float64[ndarray, "4"]]
    family: K2Family
    doubts: tuple[tuple[int, str], ...] = ()
    basis: str = "conformal"
    lines: LineEvidence | None = None
    network: Self | None = None
    trusts_network: bool = True
    strangeness: float = 0.0
    network_doubts: tuple[tuple[int, str], ...] = ()
    alone: Mapping[str, Float64[ndarray, "4"]] | None = None
    gravity: GravityBelief | None = None

    def doubted(self, verdict: int, *reasons: str) -> Self:
        """The same with more that speaks against it."""
        return replace(self, doubts=(*self.doubts, *((verdict, reason) for reason in reasons)))

    @property
    def k2(self) -> Tensor:
        """The second coefficient."""
        return k2_of_k1(self.camera.k1, self.family)

    @property
    def focal_px(self) -> float:
        """Pixels of the upright original."""
        return float(self.camera.focal) * self.view.height

    @property
    def zoom(self) -> float:
        """Heights of the photo that the part which the network saw is high."""
        return self.view.height / self.photo.height

    @property
    def side(self) -> int:
        """The longer side of the original: the unit in which photos of one camera, upright or not, are compared."""
        return max(self.photo.width, self.photo.height)

    def focal_interval(self, level: str) -> tuple[float, float]:
        """Pixels of the original; 0 and infinity where the interval of the field of view has no end."""
        vfov, half = float(vfov_from_focal(self.camera.focal)), self.half[level][2]
        wide, narrow = vfov + half, vfov - half
        low = float(focal_from_vfov(torch.tensor(wide, dtype=torch.float64))) if wide < math.pi else 0.0
        high = float(focal_from_vfov(torch.tensor(narrow, dtype=torch.float64))) if narrow > 0 else math.inf
        return low * self.view.height, high * self.view.height
