"""The interface of initialisations, which make the belief that a filter starts from."""

from abc import ABC, abstractmethod

import torch
from jaxtyping import Bool, Float64
from torch import Tensor

from sextant.localization.belief import Belief
from sextant.localization.map_prior import MapPrior
from sextant.localization.observation.evidence import Evidence


class Initialisation(ABC):
    """Makes the first belief of r runs."""

    #: Whether the first image is part of the first belief, so that it must not weigh it again.
    uses_evidence: bool = False

    @abstractmethod
    def start(
        self,
        prior: MapPrior,
        runs: int,
        particles: int,
        evidence: Evidence | None,
        seen: Bool[Tensor, "r"] | None,
        generator: torch.Generator,
    ) -> Belief:
        """The first belief.

        Args:
            prior: where the robot may be before anything is seen.
            runs: r, the number of runs.
            particles: number of particles in each run.
            evidence: evidence of the first image of each run, for initialisations that use it.
            seen: in which runs there is an image; None for all.
            generator: generator of random numbers.
        """


def weighed(poses: Float64[Tensor, "r p 3"], log_weights: Float64[Tensor, "r p"]) -> Belief:
    """A belief with the given weights; a run in which none is above zero gets equal weights."""
    usable = torch.where(log_weights.isfinite(), log_weights, -torch.inf)
    none = (usable == -torch.inf).all(1, keepdim=True)
    return Belief.of(poses, torch.where(none, 0.0, usable))
