r"""Augmented MCL: random particles are injected when recent images fit worse than they used to.

.. math:: w_{slow} \leftarrow w_{slow} + \alpha_{slow} (\bar w - w_{slow}), \quad
   w_{fast} \leftarrow w_{fast} + \alpha_{fast} (\bar w - w_{fast}), \quad
   \mathrm{share} = \max(0, 1 - w_{fast} / w_{slow})

with :math:`\bar w = \sum_i W_i e^{l(z|x_i)}` the mean likelihood of the particles. Both averages are kept as
logarithms, so that likelihoods of a hundred dimensions neither vanish nor overflow. Averages of the logarithms
themselves (geometric, the default) are not dominated by the best image so far, as arithmetic ones are. Both averages
are reset after an injection.

Source: Thrun, Burgard & Fox, "Probabilistic Robotics", MIT Press 2005, table 8.3; forgetting as in the AMCL of ROS.
"""

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.localization.map_prior import MapPrior
from sextant.localization.recovery.recovery import Injection, Memory, Recovery, anywhere, whole_number
from sextant.localization.weighted_belief import WeightedBelief
from sextant.ranges import Share, checked

Average = Literal["geometric", "arithmetic"]


@checked
@dataclass(frozen=True)
class AugmentedMCL(Recovery):
    """Injection by the ratio of a short-term to a long-term average of the likelihood.

    Attributes:
        alpha_slow: rate of the long-term average.
        alpha_fast: rate of the short-term average, which is larger.
        average: how likelihoods are averaged over time.
        most: the largest share of the particles that is replaced in one step.

    Raises:
        UserError: not 0 < alpha_slow < alpha_fast < 1, or another argument is not allowed.

    Example:
        >>> from sextant.localization.belief import Belief
        >>> from sextant.localization.observation import Evidence
        >>> class AtTen(Evidence):  # the observation matches the place at 10 m
        ...     log_likelihood = lambda self, poses: -(poses[..., 0] - 10).square()
        ...     over_map = lambda self: self.log_likelihood(line[None])
        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> recovery, prior, draws = AugmentedMCL(), MapPrior(line, 0.5, 0.1), torch.Generator()
        >>> memory, counts = recovery.memory(runs=1), []
        >>> for x in (10, 10, 0):  # where all particles are: two images fit, the third does not
        ...     weighed = WeightedBelief.of(Belief.uniform(line[x : x + 1].repeat(1, 100, 1)), AtTen(), None)
        ...     injection, memory = recovery.inject(weighed, prior, memory, draws)
        ...     counts.append(0 if injection is None else int(injection.count))
        >>> counts
        [0, 0, 50]
    """

    alpha_slow: Share = 0.001
    alpha_fast: Share = 0.1
    average: Average = "geometric"
    most: Share = 0.5

    def __post_init__(self) -> None:
        if not 0 < self.alpha_slow < self.alpha_fast < 1:
            raise ArgumentError(
                f"alpha_slow={self.alpha_slow} and alpha_fast={self.alpha_fast} must satisfy "
                "0 < alpha_slow < alpha_fast < 1",
                "For example alpha_slow=0.001 alpha_fast=0.1",
            )

    def memory(self, runs: int, device: torch.device | None = None) -> Float64[Tensor, "r 2"]:
        """The two averages; nan before the first observation and after an injection."""
        return torch.full((runs, 2), torch.nan, dtype=torch.float64, device=device)

    def inject(
        self, weighed: WeightedBelief, prior: MapPrior, memory: Memory, generator: torch.Generator
    ) -> tuple[Injection | None, Memory]:
        """Draw as many particles from the prior as the averages require."""
        before, now = memory, weighed.log_evidence[:, None]
        known = torch.where(memory.isnan(), now, memory)
        memory = torch.where(now.isfinite(), self._averaged(known, now), memory)
        slow, fast = memory.unbind(1)
        share = -torch.expm1(fast - slow).nan_to_num(0.0)
        count = whole_number(share.clamp(0, self.most), weighed.particles, generator)
        count = torch.where(weighed.seen, count, 0)
        memory = torch.where(count[:, None] > 0, torch.nan, memory)
        return anywhere(weighed, prior, count, generator), torch.where(weighed.seen[:, None], memory, before)

    def _averaged(self, before: Tensor, now: Tensor) -> Tensor:
        alpha = before.new_tensor([self.alpha_slow, self.alpha_fast])
        if self.average == "geometric":
            return before + alpha * (now - before)
        return torch.logaddexp(before + torch.log1p(-alpha), now + alpha.log())
