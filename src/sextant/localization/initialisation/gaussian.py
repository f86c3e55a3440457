"""Initialisation around a known pose."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float64
from torch import Tensor

from sextant.geometry.planar import wrap_angle
from sextant.localization.belief import Belief
from sextant.localization.initialisation.initialisation import Initialisation
from sextant.localization.map_prior import MapPrior
from sextant.localization.motion.model import check_not_negative
from sextant.localization.observation.evidence import Evidence


@dataclass(frozen=True)
class GaussianStart(Initialisation):
    """Particles around one pose in each run; the first image weighs them in the first step.

    Attributes:
        mean: the pose of each run, or one pose for all.
        sigma: standard deviations of x, y (metres, axes of the map) and heading (rad).

    Raises:
        UserError: a deviation is negative or not finite.
        ValueError: a pose is not finite.

    Example:
        >>> pose = torch.tensor([[3.0, 0.0, 0.0]], dtype=torch.float64)
        >>> start = GaussianStart(pose, sigma=(0.5, 0.2, 0.0))  # the heading is known
        >>> belief = start.start(MapPrior(pose, 0.5, 0.1), 1, 10_000, None, None, torch.Generator().manual_seed(0))
        >>> belief.poses[0].std(0).round(decimals=1)
        tensor([0.5000, 0.2000, 0.0000], dtype=torch.float64)
    """

    mean: Float64[Tensor, "r 3"]
    sigma: tuple[float, float, float]

    def __post_init__(self) -> None:
        check_not_negative("sigma", self.sigma, 3)
        if not bool(self.mean.isfinite().all()):
            raise ValueError("a pose to start from is not finite")

    def start(
        self,
        prior: MapPrior,
        runs: int,
        particles: int,
        evidence: Evidence | None,
        seen: Bool[Tensor, "r"] | None,
        generator: torch.Generator,
    ) -> Belief:
        """Draw from the Gaussians, with equal weights."""
        mean = self.mean.expand(runs, 3)[:, None]
        noise = torch.randn(runs, particles, 3, generator=generator, dtype=mean.dtype, device=mean.device)
        poses = mean + noise * mean.new_tensor(self.sigma)
        return Belief.uniform(torch.cat([poses[..., :2], wrap_angle(poses[..., 2:])], dim=2))
