r"""Restarts for a kidnapped robot, with the weight that Bayes' rule gives them.

Before each observation the robot is kidnapped with probability :math:`\epsilon`, to a place drawn from the map's prior:

.. math:: p(x_t \mid z_{1:t}) \propto e^{l(z_t \mid x_t)}
   \big[(1 - \epsilon)\, p(x_t \mid z_{1:t-1}) + \epsilon\, p_0(x_t)\big].

The first term is represented by the particles, with :math:`\log w = \log W + l(z|x) + \log(1 - \epsilon)`, and the
second by m particles drawn at map images, :math:`i \sim q(i) \propto e^{l(z \mid x_i)}`, :math:`x \sim p(x|i)`:

.. math:: \log w = \log\epsilon - \log m + \log Z + l(z \mid x) - l(z \mid x_i)
   \;\approx\; \log\epsilon - \log m + \log Z, \qquad \log Z = \log \tfrac1N \sum_i e^{l(z \mid x_i)}.

The form on the left, which is the default, is exact. The one on the right holds where the likelihood hardly changes
over the jitter, and does not weight the particles by z, as q already did. Both sums together are the evidence of z, the
filter's ``log_evidence``.

A single image is seldom enough: where many places look alike, a restart at the true one is one of many, and is thinned
out before the next images can distinguish them. With a *window* of n observations, the robot may have been kidnapped
before any of the last n + 1. A restart is weighted by the likelihood of all observations on its path since
(:class:`Trail`): :math:`\log w` gains :math:`\log T(x) - \log(n + 1)`. A single step then compares a wrong street and
the true one by all images since the start of the window. One kidnapping is considered in n + 1 steps, and counts as one
part in n + 1 in each. Where the motion before an observation is unknown, it can only be considered in that step, and
counts fully.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import torch
from annotated_types import Ge, Le
from jaxtyping import Bool, Float64
from torch import Tensor

from sextant.geometry.planar import se2_compose, se2_inverse
from sextant.localization.appearance_proposal import AppearanceProposal
from sextant.localization.constants import RARE
from sextant.localization.map_prior import MapPrior
from sextant.localization.observation.evidence import Evidence
from sextant.localization.recovery.recovery import Injection, Recovery, whole_number
from sextant.localization.weighted_belief import WeightedBelief
from sextant.ranges import Share, checked


@dataclass(frozen=True)
class Passed:
    r"""One observation of r runs, some steps ago.

    A robot that was kidnapped before the observation at τ and is now at x has come through the poses
    :math:`x_k = x \circ u_{k:t}^{-1}`, with u the odometry since step k. The belief predicted the observations with
    :math:`C_k = p(z_k \mid z_{1:k-1})`. Summed over the last n + 1 observations before which the robot may have been
    kidnapped, the pose x is worth

    .. math:: T(x) = \sum_{\tau=t-n}^{t} \prod_{k=\tau}^{t-1} \frac{e^{l(z_k \mid x_k)}}{C_k}.

    Attributes:
        evidence: its evidence.
        log_evidence: :math:`\log C_k` of the belief then.
        since: the motion since then, in the robot's frame at that time.
        counts: in which runs there was an observation and the motion since then is known.
        begins: in which runs the robot may have been kidnapped just before, and this was not yet counted fully.
    """

    evidence: Evidence
    log_evidence: Float64[Tensor, "r"]
    since: Float64[Tensor, "r 3"]
    counts: Bool[Tensor, "r"]
    begins: Bool[Tensor, "r"]


@dataclass(frozen=True)
class Trail:
    """The past observations, the latest last.

    Attributes:
        passed: at most n observations of each run.
        unknown: in which runs the motion since the last observation is unknown; None before the first.
    """

    passed: tuple[Passed, ...] = ()
    unknown: Bool[Tensor, "r"] | None = None

    def moved(self, motion: Float64[Tensor, "r 3"]) -> "Trail":
        """The trail after a motion of each run; an unknown motion, with nan, ends the trail of its run."""
        known = motion.isfinite().all(1)
        motion = motion.nan_to_num(0.0, 0.0, 0.0)
        passed = (replace(one, since=se2_compose(one.since, motion), counts=one.counts & known) for one in self.passed)
        unknown = ~known if self.unknown is None else self.unknown | ~known
        return Trail(tuple(one for one in passed if one.counts.any()), unknown)

    def updated(
        self, evidence: Evidence, log_evidence: Float64[Tensor, "r"], seen: Bool[Tensor, "r"], most: int
    ) -> "Trail":
        """The trail after one more observation; each run keeps its ``most`` latest."""
        unknown = torch.zeros_like(seen) if self.unknown is None else self.unknown
        still = log_evidence.new_zeros(len(seen), 3)
        now = Passed(evidence, log_evidence, still, seen & log_evidence.isfinite(), ~unknown)
        kept, later = [], torch.zeros_like(seen, dtype=torch.int64)
        for one in (now, *reversed(self.passed)):
            counts = one.counts & (later < most)
            later = later + one.counts
            if counts.any():
                kept.append(replace(one, counts=counts))
        return Trail(tuple(reversed(kept)), unknown & ~seen)

    def log_worth(self, poses: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p"]:
        """The log worth, log T, of current poses."""
        total = poses.new_zeros(poses.shape[:2])
        worth = total
        for one in reversed(self.passed):
            told = one.evidence.log_likelihood(se2_compose(poses, se2_inverse(one.since)[:, None]))
            told = torch.where(told.isfinite(), told - one.log_evidence[:, None], -torch.inf)
            total = total + torch.where(one.counts[:, None], told, 0.0)
            worth = torch.where((one.counts & one.begins)[:, None], torch.logaddexp(worth, total), worth)
        return worth


@checked
@dataclass(frozen=True)
class BayesRestart(Recovery):
    r"""Restarts at the map images most similar to the observation, weighted by the probability of a kidnapping.

    A step without an observation adds nothing: the hazard is per observation.

    Attributes:
        hazard: :math:`\epsilon`, the probability of a kidnapping.
        share: m/p, the share of the particles spent on restarts. It does not change the belief, only its noise. A
            filter of one particle never restarts.
        weigh_jitter: weight restarts by the likelihood at their own pose (the form on the left), at the cost of m more
            likelihoods; if false, use that of the image they were drawn at.
        window: n, the number of past observations that also weight restarts, at the cost of m n likelihoods a step. The
            motion between them is taken from odometry as it is.

    Raises:
        UserError: the hazard or the share is not between 0 and 1, or the window is negative.

    Example:
        >>> from sextant.localization.belief import Belief
        >>> from sextant.localization.observation import Evidence
        >>> class AtTen(Evidence):  # the observation matches the place at 10 m
        ...     log_likelihood = lambda self, poses: -(poses[..., 0] - 10).square()
        ...     over_map = lambda self: self.log_likelihood(line[None])
        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> weighed = WeightedBelief.of(Belief.uniform(line[:1].repeat(1, 100, 1)), AtTen(), None)  # all are at 0 m
        >>> recovery = BayesRestart(share=0.1)
        >>> injection, _ = recovery.inject(weighed, MapPrior(line, 0.1, 0.1), recovery.memory(1), torch.Generator())
        >>> int(injection.count), float(injection.poses[..., 0].mean().round())  # at the matching place
        (10, 10.0)
    """

    hazard: Share = RARE
    share: Share = 0.1
    weigh_jitter: bool = True
    window: Annotated[int, Ge(0), Le(1000)] = 0

    def memory(self, runs: int, device: torch.device | None = None) -> Trail:
        """An empty trail, before the first observation."""
        return Trail()

    def moved(self, memory: Trail, motion: Float64[Tensor, "r 3"]) -> Trail:
        """See :class:`Recovery`."""
        return memory.moved(motion)

    def inject(
        self, weighed: WeightedBelief, prior: MapPrior, memory: Trail, generator: torch.Generator
    ) -> tuple[Injection | None, Trail]:
        """Draw restarts from q with jitter."""
        injection = self._restarts(weighed, prior, memory, generator)
        if self.window == 0:
            return injection, memory
        foreseen = weighed.log_evidence
        if injection is not None:  # entries beyond a run's own count are meaningless
            drawn = torch.arange(injection.log_weights.shape[1], device=foreseen.device) < injection.count[:, None]
            restarts = injection.log_weights.masked_fill(~drawn, -torch.inf).logsumexp(1)
            foreseen = torch.where(
                injection.count > 0, torch.logaddexp(foreseen + injection.log_kept, restarts), foreseen
            )
        return injection, memory.updated(weighed.evidence, foreseen, weighed.seen, self.window)

    def _restarts(
        self, weighed: WeightedBelief, prior: MapPrior, trail: Trail, generator: torch.Generator
    ) -> Injection | None:
        proposal = AppearanceProposal.of(weighed.evidence.over_map())
        count = whole_number(self.share, weighed.particles, generator)
        count = torch.where(weighed.seen & proposal.log_total.isfinite(), count, 0)
        most = int(count.max())
        if most == 0:
            return None
        rows, scores = proposal.draw(count, generator)
        poses = prior.around(rows, generator)
        if self.weigh_jitter:
            told = weighed.evidence.log_likelihood(poses) - scores + proposal.log_evidence[:, None]
        else:
            told = proposal.log_evidence[:, None].expand(-1, most)
        log_weights = math.log(self.hazard) + told - count.clamp(min=1).double().log()[:, None]
        if self.window:
            alone = torch.zeros_like(weighed.seen) if trail.unknown is None else trail.unknown
            parts = torch.where(alone, 0.0, math.log(self.window + 1))[:, None]
            log_weights = log_weights + trail.log_worth(poses) - parts
        log_weights = torch.where(log_weights.isfinite(), log_weights, -torch.inf)
        return Injection(poses, log_weights, count, poses.new_full(count.shape, math.log1p(-self.hazard)))
