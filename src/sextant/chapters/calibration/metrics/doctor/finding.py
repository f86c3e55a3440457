"""Results of a check, and the cameras used in the checks."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from sextant.geometry import CameraParameters

DOUBLE = torch.float64


@dataclass(frozen=True)
class Finding:
    """One figure and the limits that it must keep.

    Attributes:
        check: what is checked.
        figure: what is measured, with its unit.
        value: the measured value; nan if it was not measured.
        low, high: limits, inclusive.
        skipped: why it was not measured, or None.
    """

    check: str
    figure: str
    value: float
    high: float
    low: float = 0.0
    skipped: str | None = None

    @property
    def passed(self) -> bool:
        """Whether the figure is within its limits, or was not measured."""
        return self.skipped is not None or self.low <= self.value <= self.high


def random_cameras(count: int, seed: int = 0, max_tilt: float = 1.3) -> CameraParameters:
    """Cameras of 13 to 38 mm with k1 from -0.4 to 0, float64."""
    generator = torch.Generator().manual_seed(seed)
    low = torch.tensor([-max_tilt, -math.pi / 4, 0.481, -0.4], dtype=DOUBLE)
    high = torch.tensor([max_tilt, math.pi / 4, 1.407, 0.0], dtype=DOUBLE)
    return CameraParameters(*(low + (high - low) * torch.rand(count, 4, generator=generator, dtype=DOUBLE)).unbind(-1))


def largest_bow(points: Float[Tensor, "b n 2"]) -> float:
    """Largest distance of points from the chord of their curve; nan for fewer than three points."""
    if points.shape[1] < 3:
        return math.nan
    chord = points[:, -1] - points[:, 0]
    normal = torch.stack([-chord[:, 1], chord[:, 0]], -1) / chord.norm(dim=-1, keepdim=True)
    return float(((points - points[:, :1]) * normal[:, None]).sum(-1).abs().max())
