r"""Particles around the located pose of an image, weighted so that the belief stays Bayes' rule.

With restarts (:mod:`~sextant.localization.recovery.bayes_restart`) or without any (:math:`\epsilon = 0`), the belief is

.. math:: \pi(x) = e^{l(z \mid x)} \big[(1 - \epsilon)\, p(x \mid z_{1:t-1}) + \epsilon\, p_0(x)\big].

The share :math:`1 - \lambda` of it stays with the particles and the restarts, whose weights are multiplied by that. The
share :math:`\lambda` is represented by m particles drawn around the located pose y with covariance :math:`\Sigma`,

.. math:: x \sim q(x) = \tfrac12 t_\nu(x; y, s^2 \Sigma) + \tfrac12 t_\nu\big(x; y, s^2 (\Sigma + S)\big), \qquad
   \log w = \log \lambda - \log m + \log \pi(x) - \log q(x),

where S is the jitter of restarts: the second part covers what images of the map are drawn from, in case the pose does
not weigh. The density that the filter predicts is that of :mod:`~sextant.localization.motion_density`. Where it is
unknown, only the restarts are shared. The proposal therefore changes the noise of the belief, not what it estimates.

Source: S. Thrun, D. Fox, W. Burgard, F. Dellaert, "Robust Monte Carlo localization for mobile robots", 2001, whose
mixture of both directions this is, with exact densities in place of estimated ones.
"""

import math
from dataclasses import dataclass, field

import torch
from jaxtyping import Bool, Float64
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.geometry.planar import se2_between, wrap_angle
from sextant.localization.belief import picked
from sextant.localization.map_prior import MapPrior
from sextant.localization.metric_pose import EvidenceWithPose, MetricPoses
from sextant.localization.recovery.bayes_restart import BayesRestart
from sextant.localization.recovery.recovery import Injection, Memory, NoRecovery, Recovery, whole_number
from sextant.localization.weighted_belief import WeightedBelief
from sextant.ranges import Share, checked


@checked
@dataclass(frozen=True)
class MetricProposal(Recovery):
    r"""Draws a share of the particles around located poses.

    Attributes:
        restarts: what else the filter recovers by; no other recovery is a Bayesian filter.
        share: :math:`\lambda`, and m as a share of the particles.

    Raises:
        ArgumentError: the share is not between 0 and 1, or restarts are weighed by several images.

    Example:
        >>> from sextant.localization.belief import Belief
        >>> from sextant.localization.metric_pose import MetricErrors
        >>> from sextant.localization.observation import Evidence
        >>> class Alike(Evidence):  # all images look like this one
        ...     log_likelihood = lambda self, poses: torch.zeros_like(poses[..., 0])
        ...     over_map = lambda self: self.log_likelihood(line[None])
        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> errors = MetricErrors(scale=1.0, dof=3.0, wrong=0.1, volume=100.0)
        >>> covariance = 0.01 * torch.eye(3, dtype=torch.float64)[None]
        >>> at_ten = MetricPoses(line[10:11], covariance, torch.tensor([True]), errors)
        >>> belief = Belief.uniform(line[:1].repeat(1, 100, 1))  # all are at 0 m
        >>> weighed = WeightedBelief.of(belief, EvidenceWithPose(Alike(), at_ten), None)
        >>> recovery = MetricProposal(BayesRestart(), share=0.1)
        >>> injection, _ = recovery.inject(weighed, MapPrior(line, 0.1, 0.1), recovery.memory(1), torch.Generator())
        >>> heaviest = injection.log_weights.argmax()  # of particles around the located pose and restarts
        >>> float(injection.poses[0, heaviest, 0].round())
        10.0
    """

    restarts: BayesRestart | NoRecovery = field(default_factory=NoRecovery)
    share: Share = 0.1

    def __post_init__(self) -> None:
        if isinstance(self.restarts, BayesRestart) and self.restarts.window > 0:
            raise ArgumentError(
                f"restarts: window={self.restarts.window} weighs them by several images, without what located poses "
                "found",
                "For example BayesRestart()",
            )

    def memory(self, runs: int, device: torch.device | None = None) -> Memory:
        """That of the restarts."""
        return self.restarts.memory(runs, device)

    def moved(self, memory: Memory, motion: Float64[Tensor, "r 3"]) -> Memory:
        """That of the restarts."""
        return self.restarts.moved(memory, motion)

    def inject(
        self, weighed: WeightedBelief, prior: MapPrior, memory: Memory, generator: torch.Generator
    ) -> tuple[Injection | None, Memory]:
        """Restart, and draw particles around located poses."""
        restarted, after = self.restarts.inject(weighed, prior, memory, generator)
        evidence, predicted = weighed.evidence, weighed.predicted
        foreseen = torch.zeros_like(weighed.seen) if predicted is None else predicted.known
        restarts = self._hazard > 0 and min(prior.sigmas) > 0
        if not isinstance(evidence, EvidenceWithPose):
            return restarted, after
        measured = evidence.measured
        count = whole_number(self.share, weighed.particles, generator)
        count = torch.where(weighed.seen & measured.located & (foreseen | restarts), count, 0)
        taken = torch.zeros_like(count) if restarted is None else torch.where(weighed.seen, restarted.count, 0)
        count = count.minimum(weighed.particles - 1 - taken).clamp(min=0)
        most = int(count.max())
        if most == 0:
            return restarted, after
        poses, log_q = _around(measured, prior, most, generator)
        log_pi = torch.full_like(log_q, -torch.inf)
        if predicted is not None:
            log_pi = predicted.log_density(poses) + math.log1p(-self._hazard)
        if restarts:
            log_pi = torch.logaddexp(log_pi, math.log(self._hazard) + log_prior(prior, poses))
        log_weights = log_pi + evidence_of(weighed, poses) - log_q
        log_weights = log_weights + (math.log(self.share) - count.clamp(min=1).double().log())[:, None]
        drawn = Injection(poses, log_weights, count, poses.new_zeros(len(count)))
        return _together(restarted, drawn, math.log1p(-self.share), foreseen), after

    @property
    def _hazard(self) -> float:
        return self.restarts.hazard if isinstance(self.restarts, BayesRestart) else 0.0


def evidence_of(weighed: WeightedBelief, poses: Float64[Tensor, "r m 3"]) -> Float64[Tensor, "r m"]:
    """The log-likelihood of poses, -inf where it is not finite."""
    told = weighed.evidence.log_likelihood(poses)
    return torch.where(told.isfinite(), told, -torch.inf)


def log_prior(prior: MapPrior, poses: Float64[Tensor, "r m 3"]) -> Float64[Tensor, "r m"]:
    r"""The log density of the map's prior, :math:`\log \tfrac1N \sum_i p(x \mid i)`, with jitter in all of x.

    Example:
        >>> here = MapPrior(torch.zeros(1, 3, dtype=torch.float64), 0.5, 0.1)
        >>> round(float(log_prior(here, torch.zeros(1, 1, 3, dtype=torch.float64)).exp()), 3)  # (2 pi)^-1.5 / 0.025
        2.54
    """
    sigmas = poses.new_tensor(prior.sigmas)
    constant = float(sigmas.log().sum()) + 1.5 * math.log(2 * math.pi) + math.log(len(prior.poses))
    rows = []
    for run in poses:
        apart = se2_between(prior.poses[None], run[:, None]) / sigmas
        rows.append(torch.logsumexp(-0.5 * apart.square().sum(-1), 1) - constant)
    return torch.stack(rows)


def _around(
    measured: MetricPoses, prior: MapPrior, count: int, generator: torch.Generator
) -> tuple[Float64[Tensor, "r m 3"], Float64[Tensor, "r m"]]:
    """Draws of q, and their log densities."""
    along, across, turn = prior.sigmas
    cosine, sine = measured.poses[:, 2].cos(), measured.poses[:, 2].sin()
    zero, one = torch.zeros_like(cosine), torch.ones_like(cosine)
    axes = torch.stack([cosine, -sine, zero, sine, cosine, zero, zero, zero, one], -1).reshape(-1, 3, 3)
    jitter = axes @ torch.diag(cosine.new_tensor([along**2, across**2, turn**2])) @ axes.mT
    spreads = (measured.covariances, measured.covariances + jitter)
    errors = torch.stack([measured.errors.draw(each, count, generator) for each in spreads])
    which = torch.rand(errors.shape[1:3], generator=generator, dtype=errors.dtype) < 0.5
    error = torch.where(which[..., None], errors[0], errors[1])
    densities = [measured.errors.log_density(error, each) for each in spreads]
    poses = measured.poses[:, None] + error
    poses = torch.cat([poses[..., :2], wrap_angle(poses[..., 2:])], -1)
    return poses, torch.logaddexp(*densities) - math.log(2)


def _together(restarted: Injection | None, drawn: Injection, log_rest: float, foreseen: Bool[Tensor, "r"]) -> Injection:
    """Restarts and particles around located poses, side by side; the former, and the kept, share the rest."""
    some: Bool[Tensor, "r"] = drawn.count > 0
    rest = torch.where(some, log_rest, drawn.log_kept)
    shared = torch.where(foreseen, rest, drawn.log_kept)
    if restarted is None:
        return Injection(drawn.poses, drawn.log_weights, drawn.count, shared)
    count = restarted.count + drawn.count
    at = torch.arange(int(count.max()), device=count.device)[None].expand(len(count), -1)
    first = at < restarted.count[:, None]
    before = at.clamp(max=restarted.poses.shape[1] - 1)
    later = (at - restarted.count[:, None]).clamp(0, drawn.poses.shape[1] - 1)
    poses = torch.where(first[..., None], picked(restarted.poses, before), picked(drawn.poses, later))
    weights = restarted.log_weights + rest[:, None]
    log_weights = torch.where(first, weights.gather(1, before), drawn.log_weights.gather(1, later))
    kept = torch.where(restarted.count > 0, restarted.log_kept, 0.0)
    return Injection(poses, log_weights, count, kept + shared)
