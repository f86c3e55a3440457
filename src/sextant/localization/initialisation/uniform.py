"""Initialisation anywhere on the map."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool
from torch import Tensor

from sextant.localization.belief import Belief
from sextant.localization.initialisation.initialisation import Initialisation
from sextant.localization.map_prior import MapPrior
from sextant.localization.observation.evidence import Evidence


@dataclass(frozen=True)
class UniformStart(Initialisation):
    """Particles drawn from the map's prior; the first image weighs them in the first step.

    Example:
        >>> exact = MapPrior(torch.tensor([[0.0, 0, 0], [5, 0, 0]], dtype=torch.float64), 0.0, 0.0)
        >>> belief = UniformStart().start(exact, 1, 100, None, None, torch.Generator().manual_seed(0))
        >>> belief.poses[..., 0].unique()  # without jitter they are at the images themselves
        tensor([0., 5.], dtype=torch.float64)
    """

    def start(
        self,
        prior: MapPrior,
        runs: int,
        particles: int,
        evidence: Evidence | None,
        seen: Bool[Tensor, "r"] | None,
        generator: torch.Generator,
    ) -> Belief:
        """Draw from the prior, with equal weights."""
        return Belief.uniform(prior.sample(runs, particles, generator))
