r"""Unbiased thinning: heavy particles stay as they are, and light ones survive by chance with a common weight.

Particle i of weight w survives with probability :math:`\pi_i = \min(w_i / c, 1)` and then weighs :math:`\max(w_i, c)`,
where c solves :math:`\sum_i \pi_i = K`. So expected weights do not change, and K particles remain, none of them twice.
Among such schemes, this one has the least expected squared error of the weights.

Source: Fearnhead & Clifford, "On-line inference for hidden Markov models via particle filters", JRSS-B 2003, section 3.
"""

import torch
from jaxtyping import Bool, Float64, Int64
from torch import Tensor

#: Upper bound of the random offset: just below 1, so that rounding does not add a particle.
BELOW_ONE = 1 - 1e-9


def thin(
    log_weights: Float64[Tensor, "r p"], keep: Int64[Tensor, "r"], generator: torch.Generator
) -> tuple[Bool[Tensor, "r p"], Float64[Tensor, "r p"]]:
    """Which particles survive, and their log weights (-inf for the others).

    Args:
        log_weights: need not be normalised; if a run has no weight above zero, no particle survives.
        keep: K of each run, at least 1; if no more particles than this have a weight above zero, all of them survive.
        generator: generator of random numbers.

    >>> weights = torch.tensor([[0.7, 0.1, 0.1, 0.1]], dtype=torch.float64)
    >>> survives, log_weights = thin(weights.log(), torch.tensor([2]), torch.Generator().manual_seed(0))
    >>> log_weights.exp()  # the heavy one stays as it is; one of the light ones speaks for all three
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
