r"""A particle filter over poses in the plane, for many runs at once.

.. math:: x_t^i \sim p(x_t \mid x_{t-1}^i, u_t), \qquad \log w_t^i = \log W_{t-1}^i + l(z_t \mid x_t^i), \qquad
   W_t^i = w_t^i \Big/ \sum_j w_t^j,

all in the log domain, so that a constant added to the log-likelihoods changes only the evidence. Between weighting and
normalising, a recovery may add particles elsewhere. Particles are resampled only where the effective sample size has
fallen below a share of their number.

Source: Doucet, Godsill & Andrieu, "On Sequential Monte Carlo Sampling Methods for Bayesian Filtering", 2000.
"""

import math
from dataclasses import KW_ONLY, dataclass
from functools import partial

import torch
from jaxtyping import Bool, Float64, Int64
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.localization.belief import Belief, picked
from sextant.localization.initialisation import Initialisation
from sextant.localization.kld_size import KLDSize
from sextant.localization.map_prior import MapPrior
from sextant.localization.map_support import EvidenceOnMap, MapSupport
from sextant.localization.motion import MotionModel
from sextant.localization.motion_density import Predicted
from sextant.localization.observation.evidence import Evidence
from sextant.localization.recovery import Injection, Memory, Recovery
from sextant.localization.resampling import Resampling, thin
from sextant.localization.weighted_belief import WeightedBelief
from sextant.shapes import check_shape


@dataclass(frozen=True)
class FilterState:
    """The state that a filter carries from step to step.

    Attributes:
        belief: belief of each run.
        memory: the recovery's memory of each run.
        way: distance of each run since the last observation that counted, in units of the filter's ``apart``; infinite
            before the first.
    """

    belief: Belief
    memory: Memory
    way: Float64[Tensor, "r"]


@dataclass(frozen=True)
class FilterStep:
    r"""What happened in one step of each run.

    Attributes:
        ess: effective sample size after weighting, before resampling.
        resampled: whether the run was resampled.
        injected: number of particles that a recovery added.
        log_evidence: :math:`\log p(z_t \mid z_{1:t-1})`, to the extent that the likelihoods are proper; 0 without an
            observation, -inf where no particle explained it.
        particles: number of particles that carry weight after the step.
        degenerate: whether no particle had a weight above zero. The observation is then dropped, all particles get
            equal weights, and the run goes on.
    """

    ess: Float64[Tensor, "r"]
    resampled: Bool[Tensor, "r"]
    injected: Int64[Tensor, "r"]
    log_evidence: Float64[Tensor, "r"]
    particles: Int64[Tensor, "r"]
    degenerate: Bool[Tensor, "r"]


@dataclass(frozen=True)
class ParticleFilter:
    """The steps of the filter. It holds no state itself; the state is passed to each step.

    Attributes:
        motion: the motion model.
        resampling: the scheme by which ancestors are drawn.
        recovery: adds particles for robots that are lost.
        prior: distribution of poses before the first observation.
        ess_threshold: resample below this share of the particles; 0 never, 1 whenever weights differ.
        kld: adapts the number of particles of each run; None keeps it. Arrays are then as wide as the largest run
            needs, and in the others the places beyond their own number have weight zero.
        support: where the map is informative; None uses the observation model everywhere.
        apart: distance, and turn in rad, after which an observation counts again. Images taken at one place share the
            map's errors there, so they are not independent. The shares of both add up, and an unknown motion is far
            enough. None counts every observation.

    Raises:
        UserError: the threshold is not between 0 and 1, or the distance or turn is not above 0.

    Example:
        >>> from sextant.localization import initialisation, motion, recovery, resampling
        >>> class AtThree(Evidence):  # the observation matches the place at 3 m
        ...     log_likelihood = lambda self, poses: -10 * (poses[..., 0] - 3).square()
        ...     over_map = lambda self: self.log_likelihood(line[None])
        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(10)], dtype=torch.float64)
        >>> moves, prior = motion.ExponentialMotion(), MapPrior(line, 0.5, 0.1)
        >>> filter = ParticleFilter(moves, resampling.SystematicResampling(), recovery.NoRecovery(), prior)
        >>> draws = torch.Generator().manual_seed(0)
        >>> state = filter.start(initialisation.UniformStart(), runs=1, particles=1000, generator=draws)
        >>> state, told = filter.step(state, None, AtThree(), None, draws)
        >>> told.resampled.tolist(), state.belief.poses[..., 0].mean().round().item()  # the others died out
        ([True], 3.0)
    """

    motion: MotionModel
    resampling: Resampling
    recovery: Recovery
    prior: MapPrior
    _: KW_ONLY
    ess_threshold: float = 0.5
    kld: KLDSize | None = None
    support: MapSupport | None = None
    apart: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.apart is not None and not (len(self.apart) == 2 and all(0 < each < math.inf for each in self.apart)):
            raise ArgumentError(
                f"apart={self.apart} must be a distance and a turn, above 0 and finite", "apart=(5.0, 0.5)"
            )
        if not 0 <= self.ess_threshold <= 1:
            raise ArgumentError(f"ess_threshold={self.ess_threshold} must lie between 0 and 1", "ess_threshold=0.5")

    def start(
        self,
        initialisation: Initialisation,
        runs: int,
        particles: int,
        generator: torch.Generator,
        evidence: Evidence | None = None,
        seen: Bool[Tensor, "r"] | None = None,
    ) -> FilterState:
        """The state before the first step.

        Args:
            initialisation: where particles are placed. If it ``uses_evidence``, the belief contains the first image,
                and the first step is that of the second image.
            runs: r, the number of runs filtered together.
            particles: number of particles in each run.
            generator: generator of random numbers.
            evidence: evidence of the first image.
            seen: in which runs there is a first image; None for all.

        Raises:
            UserError: the number of particles is below 1, or there is not one value of ``seen`` for each run.
        """
        if particles < 1:
            raise ArgumentError(f"particles={particles} must be at least 1", "For example particles=1000")
        if seen is not None:
            check_shape("seen", seen, runs)
        belief = initialisation.start(self.prior, runs, particles, evidence, seen, generator)
        way = belief.log_weights.new_full((runs,), math.inf)
        if initialisation.uses_evidence and evidence is not None:
            way = way.masked_fill(torch.ones_like(way, dtype=torch.bool) if seen is None else seen, 0.0)
        return FilterState(belief, self.recovery.memory(runs, belief.poses.device), way)

    def counts(self, state: FilterState, motion: Float64[Tensor, "r 3"] | None) -> Bool[Tensor, "r"]:
        """In which runs an observation would count after a motion; the others need none, as ``step`` drops it.

        Example:
            >>> from dataclasses import replace
            >>> from sextant.localization import initialisation, motion, recovery, resampling
            >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(10)], dtype=torch.float64)
            >>> parts = motion.ExponentialMotion(), resampling.SystematicResampling(), recovery.NoRecovery()
            >>> filter = ParticleFilter(*parts, MapPrior(line, 0.5, 0.1), apart=(1.0, 0.5))
            >>> state = filter.start(initialisation.UniformStart(), 3, 10, torch.Generator())
            >>> state = replace(state, way=torch.tensor([math.inf, 0.3, 0.3]).double())  # one has no observation yet
            >>> moved = torch.tensor([[0.5, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5, 0.0, 0.2]], dtype=torch.float64)
            >>> filter.counts(state, moved)  # 0.3 and half the way are too little, with two fifths of the turn enough
            tensor([ True, False,  True])
        """
        return self._way(state, motion) >= 1

    def _way(self, state: FilterState, motion: Float64[Tensor, "r 3"] | None) -> Float64[Tensor, "r"]:
        """The distance since the last observation that counted, including a motion."""
        if motion is not None:
            check_shape("motion", motion, len(state.way), 3)
        if self.apart is None:
            return torch.full_like(state.way, math.inf)
        if motion is None:
            return state.way
        return state.way + way_moved(motion, *self.apart)

    def step(
        self,
        state: FilterState,
        motion: Float64[Tensor, "r 3"] | None,
        evidence: Evidence | None,
        seen: Bool[Tensor, "r"] | None,
        generator: torch.Generator,
    ) -> tuple[FilterState, FilterStep]:
        """Move, weight, recover and resample.

        Args:
            state: state after the previous step.
            motion: motion of each run since then, in the robot's frame; a row with nan is an unknown motion, None is no
                motion at all.
            evidence: evidence of the current observations; None if no run has one.
            seen: which runs have an observation; None for all.
            generator: generator of random numbers.

        Raises:
            ArgumentError: motion, evidence or ``seen`` are those of more or fewer runs than the state.
        """
        belief, way = state.belief, self._way(state, motion)
        if seen is not None:
            check_shape("seen", seen, len(way))
        if evidence is not None and self.apart is not None:
            seen = way >= 1 if seen is None else seen & (way >= 1)
            way = way.masked_fill(seen, 0.0)
        if motion is not None:
            belief = self._moved(belief, self.motion.sample(belief.poses, motion, generator), evidence is None)
        if evidence is not None and self.support is not None:
            evidence = evidence.restricted(partial(EvidenceOnMap, support=self.support))
        memory = state.memory if motion is None else self.recovery.moved(state.memory, motion)
        runs = len(belief.log_weights)
        injected = torch.zeros(runs, dtype=torch.int64, device=belief.poses.device)
        log_evidence = belief.log_weights.new_zeros(runs)
        degenerate = torch.zeros_like(injected, dtype=torch.bool)
        if evidence is not None:
            predicted = None if motion is None else Predicted(state.belief, self.motion, motion, self.support)
            weighed = WeightedBelief.of(belief, evidence, seen, predicted)
            injection, memory = self.recovery.inject(weighed, self.prior, memory, generator)
            poses, log_weights, injected = _joined(weighed, injection, generator)
            log_evidence = log_weights.logsumexp(1)
            degenerate = log_evidence == -torch.inf
            belief = _normalised(belief, poses, log_weights, degenerate)
            injected = injected.masked_fill(degenerate, 0)
        ess = belief.ess()
        belief, resampled = self._resampled(belief, ess, generator)
        particles = (belief.log_weights > -torch.inf).sum(1)
        step = FilterStep(ess, resampled, injected, log_evidence, particles, degenerate)
        return FilterState(belief, memory, way), step

    def _moved(self, belief: Belief, poses: Tensor, normalise: bool) -> Belief:
        """Move particles; before an observation weights stay unnormalised: restarts gain the mass that left the map."""
        if self.support is None:
            return Belief(poses, belief.log_weights)
        log_weights = belief.log_weights + self.support.log_change(belief.poses, poses)
        return Belief(poses, log_weights - log_weights.logsumexp(1, keepdim=True) if normalise else log_weights)

    def _resampled(self, belief: Belief, ess: Tensor, generator: torch.Generator) -> tuple[Belief, Tensor]:
        width = belief.log_weights.shape[1]
        if self.kld is None:
            needed = ess < self.ess_threshold * width
            if not bool(needed.any()):
                return belief, needed
            ancestors = self.resampling.resample(belief.log_weights, width, generator)
            chosen = torch.where(needed[:, None], ancestors, torch.arange(width, device=ancestors.device))
            equal = Belief.uniform(belief.poses).log_weights
            return Belief(picked(belief.poses, chosen), torch.where(needed[:, None], equal, belief.log_weights)), needed
        return self._resized(belief, ess, self.kld, generator)

    def _resized(self, belief: Belief, ess: Tensor, kld: KLDSize, generator: torch.Generator) -> tuple[Belief, Tensor]:
        poses, log_weights = belief.poses, belief.log_weights
        alive = (log_weights > -torch.inf).sum(1)
        draws = self.resampling.resample(log_weights, log_weights.shape[1], generator)
        wanted = kld.for_poses(picked(poses, draws))
        needed = (ess < self.ess_threshold * alive) | ((wanted - alive).abs() > kld.tolerance * alive)
        if not bool(needed.any()):
            return belief, needed
        sizes = torch.where(needed, wanted, alive)
        width = int(sizes.max())
        ancestors = self.resampling.resample(log_weights, sizes, generator)
        # unchanged runs: particles with weight first, which reorders them but changes nothing
        order = log_weights.argsort(1, descending=True)[:, :width]
        order = torch.nn.functional.pad(order, (0, width - order.shape[1]))
        chosen = torch.where(needed[:, None], ancestors, order)
        kept = torch.where(needed[:, None], -sizes[:, None].double().log(), log_weights.gather(1, order))
        absent = torch.arange(width, device=poses.device) >= sizes[:, None]
        return Belief(picked(poses, chosen), kept.masked_fill(absent, -torch.inf)), needed


def way_moved(motion: Float64[Tensor, "*b 3"], way: float, turn: float) -> Float64[Tensor, "*b"]:
    """The extent of motions, as the sum of their distance and turn in given units; infinite for an unknown motion.

    Args:
        motion: dx and dy in the unit of the map, and dtheta in rad.
        way: distance that counts as one, in the unit of the map.
        turn: turn that counts as one, in rad.

    >>> way_moved(torch.tensor([[3.0, 4.0, 0.5], [math.nan, 0.0, 0.0]]), way=10.0, turn=1.0)
    tensor([1., inf])
    """
    moved = motion[..., :2].norm(dim=-1) / way + motion[..., 2].abs() / turn
    return torch.where(motion.isfinite().all(-1), moved, math.inf)


def _joined(
    weighed: WeightedBelief, injection: Injection | None, generator: torch.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """Poses and unnormalised weights, with the injected particles in the places that thinning freed."""
    poses, log_weights = weighed.belief.poses, weighed.log_weights
    if injection is None:
        return poses, log_weights, torch.zeros_like(weighed.seen, dtype=torch.int64)
    count = torch.where(weighed.seen, injection.count, 0)
    some = (count > 0)[:, None]
    log_weights = torch.where(some, log_weights + injection.log_kept[:, None], log_weights)
    survivors, thinned = thin(log_weights, weighed.particles - count, generator)
    survivors = torch.where(some, survivors, log_weights > -torch.inf)
    log_weights = torch.where(some, thinned, log_weights)
    rank = (~survivors).cumsum(1) - 1
    filled = ~survivors & (rank < count[:, None])
    source = rank.clamp(0, injection.log_weights.shape[1] - 1)
    new_weights = injection.log_weights.gather(1, source)
    new_weights = torch.where(new_weights.isfinite(), new_weights, -torch.inf)
    return (
        torch.where(filled[..., None], picked(injection.poses, source), poses),
        torch.where(filled, new_weights, log_weights),
        count,
    )


def _normalised(before: Belief, poses: Tensor, log_weights: Tensor, degenerate: Tensor) -> Belief:
    if not bool(degenerate.any()):
        return Belief(poses, log_weights - log_weights.logsumexp(1, keepdim=True))
    present = torch.where(before.log_weights > -torch.inf, 0.0, -torch.inf)
    poses = torch.where(degenerate[:, None, None], before.poses, poses)
    log_weights = torch.where(degenerate[:, None], present, log_weights)
    return Belief(poses, log_weights - log_weights.logsumexp(1, keepdim=True))
