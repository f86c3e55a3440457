"""Anywhere on the map."""

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
    """Particles drawn from the map's prior; the first image weighs them in the first step."""

    def start(
        self,
        prior: MapPrior,
        runs: int,
        particles: int,
        evidence: Evidence | None,
        seen: Bool[Tensor, "r"] | None,
        generator: torch.Generator,
    ) -> Belief:
        """Draws of the prior, all with the same weight."""
        return Belief.uniform(prior.sample(runs, particles, generator))
