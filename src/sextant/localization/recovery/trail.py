r"""The last observations, joined by odometry: what a robot would have seen on its way to where it may be now.

A robot that was kidnapped before the observation at τ and is now at x has come through the poses
:math:`x_k = x \circ u_{k:t}^{-1}`, with u the odometry since step k. The belief had foreseen the observations with
:math:`C_k = p(z_k \mid z_{1:k-1})`. Summed over the last n + 1 observations before which the robot may have been
kidnapped, the pose x is worth

.. math:: T(x) = \sum_{\tau=t-n}^{t} \prod_{k=\tau}^{t-1} \frac{e^{l(z_k \mid x_k)}}{C_k}.
"""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float64
from torch import Tensor

from sextant.geometry.planar import se2_compose, se2_inverse
from sextant.localization.observation.evidence import Evidence


@dataclass(frozen=True)
class Passed:
    r"""One observation of r runs, some steps ago.

    Attributes:
        evidence: what was seen.
        log_evidence: :math:`\log C_k` of the belief then.
        since: the motion since then, in the robot's frame at that time.
        counts: in which runs something was seen and the motion since then is known.
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

    def seen(
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
