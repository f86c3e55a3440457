"""Resampling: the choice of the particles that the next ones descend from, and unbiased thinning."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float64, Int64
from torch import Tensor

__all__ = [
    "MultinomialResampling",
    "Resampling",
    "ResidualResampling",
    "StratifiedResampling",
    "SystematicResampling",
    "thin",
]


class Resampling(ABC):
    """Draws ancestors in all runs at once.

    All are unbiased: of n draws, an expected :math:`n W_i` are of particle i. They differ in the variance of that
    number. Source: Douc, Cappé & Moulines, "Comparison of Resampling Schemes for Particle Filtering", ISPA 2005.
    """

    def resample(
        self,
        log_weights: Float64[Tensor, "r p"],
        count: int | Int64[Tensor, "r"],
        generator: torch.Generator,
    ) -> Int64[Tensor, "r c"]:
        """Indices of the ancestors.

        Args:
            log_weights: need not be normalised.
            count: number of particles to draw, one for all runs or one for each. In the second case the result is as
                wide as the largest count, and indices beyond a run's own count are meaningless.
            generator: generator of random numbers.

        Raises:
            ValueError: a run has no weight above zero or one that is nan or infinite, or a count is below 1.
        """
        best = log_weights.amax(1, keepdim=True)
        if not bool(best.isfinite().all()):
            raise ValueError("there is a run with no weight above zero, or with a weight that is nan or infinite")
        counts = torch.as_tensor(count, device=log_weights.device).expand(len(log_weights))[:, None]
        if bool((counts < 1).any()):
            raise ValueError("at least one particle must be drawn in each run")
        weights = (log_weights - best).exp()
        return self.ancestors(weights / weights.sum(1, keepdim=True), counts, int(counts.max()), generator)

    @abstractmethod
    def ancestors(
        self,
        weights: Float64[Tensor, "r p"],
        counts: Int64[Tensor, "r 1"],
        width: int,
        generator: torch.Generator,
    ) -> Int64[Tensor, "r c"]:
        """Draw the indices, given weights that sum to one."""


def at_quantiles(weights: Float64[Tensor, "r p"], quantiles: Float64[Tensor, "r c"]) -> Int64[Tensor, "r c"]:
    """The particle at each quantile in [0, 1) of the weight distribution; never one of weight zero.

    Quantiles of 1 and above give the last particle with a weight.

    Example:
        >>> at_quantiles(torch.tensor([[0.5, 0.0, 0.5]]).double(), torch.tensor([[0.2, 0.5, 1.0]]).double())
        tensor([[0, 2, 2]])
    """
    cumulative = weights.cumsum(1)
    total = cumulative[:, -1:].contiguous()
    last = torch.searchsorted(cumulative, total)  # the first to reach the total: all after it have no weight
    return torch.searchsorted(cumulative, quantiles * total, right=True).minimum(last)


@dataclass(frozen=True)
class MultinomialResampling(Resampling):
    """Draws each ancestor independently, as in the bootstrap filter of Gordon, Salmond & Smith (IEE-F 1993).

    Example:
        >>> log_weights = torch.tensor([[0.5, 0.25, 0.25]]).double().log()
        >>> MultinomialResampling().resample(log_weights, 4, torch.Generator().manual_seed(0))  # not in proportion
        tensor([[2, 1, 0, 2]])
    """

    def ancestors(
        self,
        weights: Float64[Tensor, "r p"],
        counts: Int64[Tensor, "r 1"],
        width: int,
        generator: torch.Generator,
    ) -> Int64[Tensor, "r c"]:
        """Draw with replacement."""
        uniform = torch.rand(len(weights), width, generator=generator, dtype=weights.dtype, device=weights.device)
        return at_quantiles(weights, uniform)


@dataclass(frozen=True)
class ResidualResampling(Resampling):
    r"""Makes :math:`\lfloor n W_i \rfloor` copies of each particle and draws the others by the rest of :math:`n W_i`.

    Source: Liu & Chen, "Sequential Monte Carlo Methods for Dynamic Systems", JASA 1998.

    Example:
        >>> log_weights = torch.tensor([[0.5, 0.25, 0.25]]).double().log()
        >>> ResidualResampling().resample(log_weights, 4, torch.Generator())  # n W is whole: nothing is random
        tensor([[0, 0, 1, 2]])
    """

    def ancestors(
        self,
        weights: Float64[Tensor, "r p"],
        counts: Int64[Tensor, "r 1"],
        width: int,
        generator: torch.Generator,
    ) -> Int64[Tensor, "r c"]:
        """Copy in the order of the particles, then draw."""
        expected = weights * counts
        copies = expected.floor()
        slots = torch.arange(width, dtype=torch.int64, device=weights.device).expand(len(weights), -1).contiguous()
        taken = copies.long().cumsum(1)
        copied = torch.searchsorted(taken, slots, right=True).clamp(max=weights.shape[1] - 1)
        left = expected - copies
        left = torch.where(left.sum(1, keepdim=True) > 0, left, weights)  # if nothing is left, no draw will be used
        uniform = torch.rand(len(weights), width, generator=generator, dtype=weights.dtype, device=weights.device)
        return torch.where(slots < taken[:, -1:], copied, at_quantiles(left, uniform))


@dataclass(frozen=True)
class StratifiedResampling(Resampling):
    r"""Draws particles at the quantiles :math:`(k + u_k)/n`, :math:`u_k \sim U[0, 1)`.

    The variance is never larger than that of independent draws.

    Example:
        >>> log_weights = torch.tensor([[0.5, 0.25, 0.25]]).double().log()
        >>> StratifiedResampling().resample(log_weights, 4, torch.Generator())  # one in each quarter of the weight
        tensor([[0, 0, 1, 2]])
    """

    def ancestors(
        self,
        weights: Float64[Tensor, "r p"],
        counts: Int64[Tensor, "r 1"],
        width: int,
        generator: torch.Generator,
    ) -> Int64[Tensor, "r c"]:
        """Draw once within each stratum."""
        offsets = torch.rand(len(weights), width, generator=generator, dtype=weights.dtype, device=weights.device)
        return at_quantiles(weights, (torch.arange(width, device=weights.device) + offsets) / counts)


@dataclass(frozen=True)
class SystematicResampling(Resampling):
    r"""Draws particles at the quantiles :math:`(k + u)/n`, with one number :math:`u \sim U[0, 1)` for each run.

    Each particle is drawn :math:`\lfloor n W_i \rfloor` or :math:`\lceil n W_i \rceil` times. In practice this has the
    least variance, though the number of copies of a particle depends on the order of the others.

    Example:
        >>> log_weights = torch.tensor([[0.6, 0.3, 0.1]]).double().log()
        >>> SystematicResampling().resample(log_weights, 10, torch.Generator().manual_seed(0))  # 6, 3 and 1
        tensor([[0, 0, 0, 0, 0, 0, 1, 1, 1, 2]])
    """

    def ancestors(
        self,
        weights: Float64[Tensor, "r p"],
        counts: Int64[Tensor, "r 1"],
        width: int,
        generator: torch.Generator,
    ) -> Int64[Tensor, "r c"]:
        """Draw at equal steps from a random offset."""
        offset = torch.rand(len(weights), 1, generator=generator, dtype=weights.dtype, device=weights.device)
        return at_quantiles(weights, (torch.arange(width, device=weights.device) + offset) / counts)


#: Upper bound of the random offset: just below 1, so that rounding does not add a particle.
BELOW_ONE = 1 - 1e-9


def thin(
    log_weights: Float64[Tensor, "r p"], keep: Int64[Tensor, "r"], generator: torch.Generator
) -> tuple[Bool[Tensor, "r p"], Float64[Tensor, "r p"]]:
    r"""Which particles survive, and their log weights (-inf for the others).

    Particle i of weight w survives with probability :math:`\pi_i = \min(w_i / c, 1)` and then has weight
    :math:`\max(w_i, c)`, where c solves :math:`\sum_i \pi_i = K`. So expected weights do not change, and K particles
    remain, none of them twice. Among such schemes, this one has the least expected squared error of the weights.

    Source: Fearnhead & Clifford, "On-line inference for hidden Markov models via particle filters", JRSS-B 2003,
    section 3.

    Args:
        log_weights: need not be normalised; if a run has no weight above zero, no particle survives.
        keep: K of each run, at least 1; if no more particles than this have a weight above zero, all of them survive.
        generator: generator of random numbers.

    >>> weights = torch.tensor([[0.7, 0.1, 0.1, 0.1]], dtype=torch.float64)
    >>> survives, log_weights = thin(weights.log(), torch.tensor([2]), torch.Generator().manual_seed(0))
    >>> log_weights.exp()  # the heavy one is unchanged; one light one represents all three
    tensor([[0.7000, 0.3000, 0.0000, 0.0000]], dtype=torch.float64)
    """
    best = log_weights.amax(1, keepdim=True)
    best = torch.where(best.isfinite(), best, 0.0)
    weights = (log_weights - best).exp()
    threshold = _threshold(weights, keep.clamp(max=weights.shape[1]))
    heavy = (weights >= threshold) & (weights > 0)
    chances = torch.where(heavy | (weights <= 0), 0.0, weights / threshold)
    offset = torch.rand(len(weights), 1, generator=generator, dtype=weights.dtype, device=weights.device)
    reached = (_to_whole(chances.cumsum(1)) + offset * BELOW_ONE).floor()
    lucky = torch.diff(reached, dim=1, prepend=torch.zeros_like(offset)) > 0
    survivors = heavy | lucky
    lifted = torch.where(heavy, log_weights, threshold.log() + best)
    return survivors, torch.where(survivors, lifted, -torch.inf)


def _threshold(weights: Tensor, keep: Tensor) -> Tensor:
    """The threshold c: the j heaviest are kept, the others share K - j places; j is least such that these are light."""
    particles = weights.shape[1]
    ascending = weights.sort(1).values
    rest = ascending.cumsum(1).flip(1)  # mass of all but the j heaviest
    heaviest = ascending.flip(1)
    places = keep[:, None] - torch.arange(particles, device=weights.device)
    fits = (heaviest * places <= rest) | (places <= 1)
    first = fits.to(torch.int8).argmax(1, keepdim=True)
    return rest.gather(1, first) / places.gather(1, first).clamp(min=1)


def _to_whole(sums: Tensor) -> Tensor:
    """Make the last sum, a whole number but for rounding, exactly whole."""
    last = sums[:, -1:]
    return torch.where(last > 0, sums * (last.round() / last), sums)
