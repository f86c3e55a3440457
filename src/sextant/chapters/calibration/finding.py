"""Intermediate camera estimates of photos."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import torch
from jaxtyping import Float64
from numpy import ndarray
from scipy.special import stdtrit
from torch import Tensor

from sextant.baselines.calibration import CameraBelief, GravityBelief, JointEstimate, LineEvidence
from sextant.data.photos import NetworkView, Photo
from sextant.geometry import CameraParameters, K2Family, focal_from_vfov, k2_of_k1, vfov_from_focal

LEVELS = {"68": (0.68, 1.0), "95": (0.95, 1.96)}  # name: share of photos, and multiple of a normal standard error
#: by level, the multiple of a belief's standard error by the loss that it has among all evidence, Student's t
STUDENT = {level: float(stdtrit(CameraBelief.nu, (1 + share) / 2)) for level, (share, _) in LEVELS.items()}


class Doubt(NamedTuple):
    """A reason against a camera.

    Attributes:
        allows: best verdict that it allows: 0 good, 1 weak, 2 not trustworthy.
        reason: in words.
        modelled: whether the fitted model of errors accounts for it, so that it limits no verdict by that model.
    """

    allows: int
    reason: str
    modelled: bool = False


@dataclass(frozen=True, eq=False)
class Finding:
    """An intermediate estimate of a photo's camera. Focal length and k1_hat are in heights of the network's view.

    Attributes:
        name: name of the photo.
        photo: the photo as read, without its picture.
        view: the part of the photo given to the network.
        camera: tilt, roll, focal and k1, float64 scalars.
        half: by level, half-widths of the intervals of tilt, roll, vfov (radians) and k1_hat.
        family: family of the lens.
        doubts: reasons against the camera.
        basis: how the intervals were obtained.
        lines: lines of the photo; None if they are not used.
        network: the finding of the network alone, if ``camera`` uses other evidence too.
        trusts_network: whether the network contributed to ``camera``.
        strangeness: distance of the photo's appearance from the validation images, in units of their 95 % quantile.
        network_doubts: as ``doubts``, against the finding of the network alone.
        alone: half-widths of the intervals from this photo alone, if ``half`` is fused with others.
        gravity: gravity that contributes to ``camera`` besides the picture.
        of_others: whether the network is one of others, whose half-widths are :data:`STUDENT` of its standard errors.
        joint: the joint estimate of this photo by itself, without other beliefs about its camera.
    """

    name: str
    photo: Photo
    view: NetworkView
    camera: CameraParameters
    half: Mapping[str, Float64[ndarray, "4"]]
    family: K2Family
    doubts: tuple[Doubt, ...] = ()
    basis: str = "conformal"
    lines: LineEvidence | None = None
    network: Self | None = None
    trusts_network: bool = True
    strangeness: float = 0.0
    network_doubts: tuple[Doubt, ...] = ()
    alone: Mapping[str, Float64[ndarray, "4"]] | None = None
    gravity: GravityBelief | None = None
    of_others: bool = False
    joint: JointEstimate | None = None

    def doubted(self, allows: int, *reasons: str, modelled: bool = False) -> Self:
        """The same finding with further doubts."""
        return replace(self, doubts=(*self.doubts, *(Doubt(allows, reason, modelled) for reason in reasons)))

    @property
    def k2(self) -> Tensor:
        """The second coefficient."""
        return k2_of_k1(self.camera.k1, self.family)

    @property
    def focal_px(self) -> float:
        """Focal length in pixels of the upright original."""
        return float(self.camera.focal) * self.view.height

    @property
    def zoom(self) -> float:
        """Height of the network's view, in heights of the photo."""
        return self.view.height / self.photo.height

    @property
    def side(self) -> int:
        """The longer side of the original: the unit in which photos of one camera are compared in any orientation."""
        return max(self.photo.width, self.photo.height)

    def focal_interval(self, level: str) -> tuple[float, float]:
        """Interval in pixels of the original; 0 or infinity where the field of view reaches π or 0."""
        vfov, half = float(vfov_from_focal(self.camera.focal)), self.half[level][2]
        wide, narrow = vfov + half, vfov - half
        low = float(focal_from_vfov(torch.tensor(wide, dtype=torch.float64))) if wide < math.pi else 0.0
        high = float(focal_from_vfov(torch.tensor(narrow, dtype=torch.float64))) if narrow > 0 else math.inf
        return low * self.view.height, high * self.view.height
