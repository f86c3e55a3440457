"""Recoveries: particles placed elsewhere, for a robot that is not where the filter believes it to be."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float64, Int64
from torch import Tensor

from sextant.localization.map_prior import MapPrior
from sextant.localization.weighted_belief import WeightedBelief
from sextant.ranges import Share, checked

#: state that a recovery carries for all runs from step to step; its type is private to the recovery
Memory = Any


@dataclass(frozen=True)
class Injection:
    r"""Particles to be added in each run.

    Attributes:
        poses: :math:`\tilde x_k`.
        log_weights: :math:`v_k`, on the scale of :attr:`WeightedBelief.log_weights`.
        count: m of each run; entries beyond it are meaningless.
        log_kept: :math:`\kappa`, which is added to the log weights of the kept particles.
    """

    poses: Float64[Tensor, "r m 3"]
    log_weights: Float64[Tensor, "r m"]
    count: Int64[Tensor, "r"]
    log_kept: Float64[Tensor, "r"]


class Recovery(ABC):
    r"""Proposes particles after each observation.

    A recovery adds a second measure to that of the kept particles,

    .. math:: e^{\kappa} \sum_i W_i e^{l(z \mid x_i)} \, \delta(x - x_i) +
       \sum_{k=1}^{m} e^{v_k}\, \delta(x - \tilde x_k),

    and the filter makes room for the m injected particles by thinning the others without bias
    (:func:`~sextant.localization.resampling.thin`); leaving out the m lightest would lose their mass. A recovery has no
    state of its own: its memory is passed to each step and returned.
    """

    def memory(self, runs: int, device: torch.device | None = None) -> Memory:
        """The memory before the first observation; None for a recovery without memory."""
        return None

    def moved(self, memory: Memory, motion: Float64[Tensor, "r 3"]) -> Memory:
        """The memory after a motion of each run in the robot's frame, nan where it is unknown."""
        return memory

    @abstractmethod
    def inject(
        self,
        weighed: WeightedBelief,
        prior: MapPrior,
        memory: Memory,
        generator: torch.Generator,
    ) -> tuple[Injection | None, Memory]:
        """The particles to add, and the new memory, which does not change for runs without an observation.

        Args:
            weighed: the particles, weighted by the observation.
            prior: distribution of a kidnapped robot's pose.
            memory: the memory so far.
            generator: generator of random numbers.
        """


def whole_number(
    share: float | Float64[Tensor, "r"], particles: Int64[Tensor, "r"], generator: torch.Generator
) -> Int64[Tensor, "r"]:
    """A share of each run's particles, randomly rounded so that its mean is exact; at least one particle stays."""
    chance = torch.rand(len(particles), generator=generator, dtype=torch.float64, device=particles.device)
    return (share * particles + chance).floor().long().minimum(particles - 1).clamp(min=0)


@dataclass(frozen=True)
class NoRecovery(Recovery):
    """Adds nothing.

    Example:
        >>> NoRecovery().memory(runs=3) is None  # it has no memory either
        True
    """

    def inject(
        self, weighed: WeightedBelief, prior: MapPrior, memory: Memory, generator: torch.Generator
    ) -> tuple[Injection | None, Memory]:
        """Add nothing."""
        return None, memory


@checked
@dataclass(frozen=True)
class UniformInjection(Recovery):
    """Replaces a share of the posterior by the map's prior after weighting by the image.

    Each injected particle thus has the weight of an average one, and the next image decides. This is not a Bayesian
    filter: that share of the belief is lost again at every step, whatever the observation.

    Attributes:
        share: share of the particles, and of the mass.

    Raises:
        UserError: the share is not between 0 and 1.

    Example:
        >>> from sextant.localization.belief import Belief
        >>> from sextant.localization.observation import Evidence
        >>> class AtTen(Evidence):  # the observation matches the place at 10 m
        ...     log_likelihood = lambda self, poses: -(poses[..., 0] - 10).square()
        ...     over_map = lambda self: self.log_likelihood(line[None])
        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> weighed = WeightedBelief.of(Belief.uniform(line[:1].repeat(1, 100, 1)), AtTen(), None)  # all are at 0 m
        >>> injection, _ = UniformInjection(0.05).inject(weighed, MapPrior(line, 0.5, 0.1), None, torch.Generator())
        >>> mass = (injection.log_weights.logsumexp(1) - weighed.log_evidence).exp()
        >>> int(injection.count), float(mass.round(decimals=6))  # of 100 particles, and of the mass
        (5, 0.05)
    """

    share: Share = 0.05

    def inject(
        self, weighed: WeightedBelief, prior: MapPrior, memory: Memory, generator: torch.Generator
    ) -> tuple[Injection | None, Memory]:
        """Draw from the prior."""
        count = whole_number(self.share, weighed.particles, generator)
        return anywhere(weighed, prior, count, generator), memory


def anywhere(
    weighed: WeightedBelief, prior: MapPrior, count: Int64[Tensor, "r"], generator: torch.Generator
) -> Injection | None:
    """``count`` draws from the prior with an average weight each, in place of an equal share of the posterior."""
    most = int(count.max())
    if most == 0:
        return None
    particles = weighed.particles
    average = weighed.log_evidence - particles.double().log()
    return Injection(
        prior.sample(len(count), most, generator),
        average[:, None].expand(-1, most),
        count,
        torch.log1p(-count.double() / particles),
    )
