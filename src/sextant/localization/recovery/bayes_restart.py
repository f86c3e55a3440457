r"""A robot that may be carried away: restarts with the weight that Bayes' rule gives them.

At each observation the robot has been carried with probability :math:`\epsilon` to a place drawn from the map's prior:

.. math:: p(x_t \mid z_{1:t}) \propto e^{l(z_t \mid x_t)}
   \big[(1 - \epsilon)\, p(x_t \mid z_{1:t-1}) + \epsilon\, p_0(x_t)\big].

The first term is that of the particles, with :math:`\log w = \log W + l(z|x) + \log(1 - \epsilon)`. The second is that
of m particles drawn at map images, :math:`i \sim q(i) \propto e^{l(z \mid x_i)}`, :math:`x \sim p(x|i)`:

.. math:: \log w = \log\epsilon - \log m + \log Z + l(z \mid x) - l(z \mid x_i)
   \;\approx\; \log\epsilon - \log m + \log Z, \qquad \log Z = \log \tfrac1N \sum_i e^{l(z \mid x_i)}.

The form on the left, which is the default, is exact. The one on the right holds where the likelihood hardly changes
over the jitter, and does not weigh the particles by z: q already did. Both sums together are the evidence of z: the
filter's ``log_evidence``.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.localization.appearance_proposal import AppearanceProposal
from sextant.localization.map_prior import MapPrior
from sextant.localization.recovery.recovery import Injection, Recovery, check_share, whole_number
from sextant.localization.weighed import Weighed


@dataclass(frozen=True)
class BayesRestart(Recovery):
    r"""Restarts at the map images that the observation looks like, weighted by the chance of having been carried away.

    A step without an observation adds nothing: the hazard is one of observations.

    Attributes:
        hazard: :math:`\epsilon`.
        share: of the particles that are spent on restarts: m/p. It does not change the belief, only its noise. A
            filter of one particle never restarts.
        weigh_jitter: weigh restarts by the likelihood at their own pose (the form on the left), at the cost of m more
            likelihoods; false takes that of the image they were drawn at.

    Raises:
        UserError: the hazard or the share is not between 0 and 1.
    """

    hazard: float = 1e-3
    share: float = 0.1
    weigh_jitter: bool = True

    def __post_init__(self) -> None:
        check_share("hazard", self.hazard)
        check_share("share", self.share)

    def inject(
        self, weighed: Weighed, prior: MapPrior, memory: Float64[Tensor, "r s"], generator: torch.Generator
    ) -> tuple[Injection | None, Float64[Tensor, "r s"]]:
        """Draws of q with jitter."""
        proposal = AppearanceProposal.of(weighed.evidence.over_map())
        count = whole_number(self.share, weighed.particles, generator)
        count = torch.where(weighed.seen & proposal.log_total.isfinite(), count, 0)
        most = int(count.max())
        if most == 0:
            return None, memory
        rows, scores = proposal.draw(count, generator)
        poses = prior.around(rows, generator)
        if self.weigh_jitter:
            told = weighed.evidence.log_likelihood(poses) - scores + proposal.log_evidence[:, None]
        else:
            told = proposal.log_evidence[:, None].expand(-1, most)
        log_weights = math.log(self.hazard) + told - count.clamp(min=1).double().log()[:, None]
        return Injection(poses, log_weights, count, poses.new_full(count.shape, math.log1p(-self.hazard))), memory
