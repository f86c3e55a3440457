"""Random particles anywhere on the map, injected at every observation."""

from dataclasses import dataclass

import torch
from jaxtyping import Int64
from torch import Tensor

from sextant.localization.map_prior import MapPrior
from sextant.localization.recovery.recovery import Injection, Memory, Recovery, check_share, whole_number
from sextant.localization.weighed import Weighed


@dataclass(frozen=True)
class UniformInjection(Recovery):
    """Replaces a share of the posterior by the map's prior after the image has weighed it.

    Each injected particle thus has the weight of an average one, and the next image decides. This is not a Bayesian
    filter: that share of the belief is lost again at every step, whatever was seen.

    Attributes:
        share: share of the particles, and of the mass.

    Raises:
        UserError: the share is not between 0 and 1.

    Example:
        >>> from sextant.localization.belief import Belief
        >>> from sextant.localization.observation import Evidence
        >>> class AtTen(Evidence):  # what is seen looks like the place at 10 m
        ...     log_likelihood = lambda self, poses: -(poses[..., 0] - 10).square()
        ...     over_map = lambda self: self.log_likelihood(line[None])
        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> weighed = Weighed.of(Belief.uniform(line[:1].repeat(1, 100, 1)), AtTen(), None)  # all are at 0 m
        >>> injection, _ = UniformInjection(0.05).inject(weighed, MapPrior(line, 0.5, 0.1), None, torch.Generator())
        >>> mass = (injection.log_weights.logsumexp(1) - weighed.log_evidence).exp()
        >>> int(injection.count), float(mass.round(decimals=6))  # of 100 particles, and of the mass
        (5, 0.05)
    """

    share: float = 0.05

    def __post_init__(self) -> None:
        check_share("share", self.share)

    def inject(
        self, weighed: Weighed, prior: MapPrior, memory: Memory, generator: torch.Generator
    ) -> tuple[Injection | None, Memory]:
        """Draw from the prior."""
        count = whole_number(self.share, weighed.particles, generator)
        return anywhere(weighed, prior, count, generator), memory


def anywhere(
    weighed: Weighed, prior: MapPrior, count: Int64[Tensor, "r"], generator: torch.Generator
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
