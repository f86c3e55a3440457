"""What every initialisation offers: the belief a filter starts from."""

from abc import ABC, abstractmethod

import torch
from jaxtyping import Bool, Float64
from torch import Tensor

from sextant.localization.belief import Belief
from sextant.localization.map_prior import MapPrior
from sextant.localization.observation.evidence import Evidence


class Initialisation(ABC):
    """Makes the first belief of r runs."""

    #: Whether the first image is in the belief already, and must not weigh it again.
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
            prior: where a robot may be before anything is seen.
            runs: r.
            particles: of each run.
            evidence: of the first image of each run, for those that use it.
            seen: in which runs there is an image; None for all.
            generator: of random numbers.
        """


def weighed(poses: Float64[Tensor, "r p 3"], log_weights: Float64[Tensor, "r p"]) -> Belief:
    """A belief with these weights; in a run where none is above zero, all particles weigh the same."""
    usable = torch.where(log_weights.isfinite(), log_weights, -torch.inf)
    none = (usable == -torch.inf).all(1, keepdim=True)
    return Belief.of(poses, torch.where(none, 0.0, usable))
