r"""What every recovery offers: particles elsewhere, for a robot that is not where the filter believes it to be.

A recovery adds a second measure to that of the particles that are kept,

.. math:: e^{\kappa} \sum_i W_i e^{l(z \mid x_i)} \, \delta(x - x_i) + \sum_{k=1}^{m} e^{v_k}\, \delta(x - \tilde x_k),

and the filter makes room for the m injected particles by thinning the others without bias
(:func:`~sextant.localization.resampling.thin`); to leave out the m lightest would lose their mass. What a recovery
remembers from step to step is handed to it and back: it has no state of its own.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float64, Int64
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.localization.map_prior import MapPrior
from sextant.localization.weighed import Weighed

#: what a recovery remembers of all runs from step to step; only it can tell what that is
Memory = Any


@dataclass(frozen=True)
class Injection:
    r"""Particles to be added in each run.

    Attributes:
        poses: :math:`\tilde x_k`.
        log_weights: :math:`v_k`, on the scale of :attr:`Weighed.log_weights`.
        count: m of each run; what stands beyond it means nothing.
        log_kept: :math:`\kappa`, what the kept particles' weights are lowered by.
    """

    poses: Float64[Tensor, "r m 3"]
    log_weights: Float64[Tensor, "r m"]
    count: Int64[Tensor, "r"]
    log_kept: Float64[Tensor, "r"]


class Recovery(ABC):
    """Proposes particles after each observation."""

    def memory(self, runs: int, device: torch.device | None = None) -> Memory:
        """What it remembers before the first observation; None for a recovery that remembers nothing."""
        return None

    def moved(self, memory: Memory, motion: Float64[Tensor, "r 3"]) -> Memory:
        """What it remembers after a motion of each run, in the robot's frame; nan where it is unknown."""
        return memory

    @abstractmethod
    def inject(
        self,
        weighed: Weighed,
        prior: MapPrior,
        memory: Memory,
        generator: torch.Generator,
    ) -> tuple[Injection | None, Memory]:
        """What to add, and what to remember; of runs that saw nothing that is what they remembered.

        Args:
            weighed: the particles and what the observation says of them.
            prior: where a robot may be that was carried away.
            memory: what it remembered.
            generator: of random numbers.
        """


def whole_number(
    share: float | Float64[Tensor, "r"], particles: Int64[Tensor, "r"], generator: torch.Generator
) -> Int64[Tensor, "r"]:
    """A share of each run's particles, rounded at random so that its mean is right; at least one particle stays."""
    chance = torch.rand(len(particles), generator=generator, dtype=torch.float64, device=particles.device)
    return (share * particles + chance).floor().long().minimum(particles - 1).clamp(min=0)


def check_share(argument: str, share: float) -> None:
    """Refuse a share that is not in (0, 1).

    Raises:
        ArgumentError: names the argument and the value.
    """
    if not 0 < share < 1:
        raise ArgumentError(f"{argument}={share} must lie between 0 and 1", f"For example {argument}=0.1")
