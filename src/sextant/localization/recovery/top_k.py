"""Particles at the map images most similar to the observation, weighted by it a second time: a known mistake.

It is kept for comparison with :class:`~sextant.localization.recovery.BayesRestart`. An image that looks like a wrong
place proposes that place, and then the same image confirms it: its likelihood counts twice.
"""

from dataclasses import dataclass

import torch

from sextant.localization.appearance_proposal import AppearanceProposal
from sextant.localization.map_prior import MapPrior
from sextant.localization.recovery.recovery import Injection, Memory, Recovery, whole_number
from sextant.localization.weighted_belief import WeightedBelief
from sextant.ranges import Count, Share, checked


@checked
@dataclass(frozen=True)
class TopKInjection(Recovery):
    """Draws a share of the particles at the best map images, by their likelihood, before all are weighted by the image.

    Attributes:
        share: share of the particles, and of the mass before the observation.
        top: number of map images that are drawn from.

    Raises:
        UserError: the share is not between 0 and 1, or ``top`` is below 1.

    Example:
        >>> from sextant.localization.belief import Belief
        >>> from sextant.localization.observation import Evidence
        >>> class AtTen(Evidence):  # the observation matches the place at 10 m
        ...     log_likelihood = lambda self, poses: -(poses[..., 0] - 10).square()
        ...     over_map = lambda self: self.log_likelihood(line[None])
        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> weighed = WeightedBelief.of(Belief.uniform(line[:1].repeat(1, 100, 1)), AtTen(), None)  # all are at 0 m
        >>> recovery = TopKInjection(share=0.1, top=1)
        >>> injection, _ = recovery.inject(weighed, MapPrior(line, 0.1, 0.1), None, torch.Generator())
        >>> int(injection.count), injection.poses[..., 0].round().unique().tolist()
        (10, [10.0])
    """

    share: Share = 0.05
    top: Count = 10

    def inject(
        self, weighed: WeightedBelief, prior: MapPrior, memory: Memory, generator: torch.Generator
    ) -> tuple[Injection | None, Memory]:
        """Draw from the best images with jitter, weighted by the same observation."""
        particles = weighed.particles
        proposal = AppearanceProposal.of(weighed.evidence.over_map(), self.top)
        count = whole_number(self.share, particles, generator)
        count = torch.where(weighed.seen & proposal.log_total.isfinite(), count, 0)
        most = int(count.max())
        if most == 0:
            return None, memory
        rows, _ = proposal.draw(count, generator)
        poses = prior.around(rows, generator)
        log_weights = weighed.evidence.log_likelihood(poses) - particles.double().log()[:, None]
        return Injection(poses, log_weights, count, torch.log1p(-count.double() / particles)), memory
