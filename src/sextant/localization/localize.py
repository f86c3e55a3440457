"""Running a particle filter along whole runs, many at once or one robot step by step."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from torch import Tensor

from sextant.evaluation.protocols import MODE_MASS
from sextant.localization.adaptation import Adaptation, Learned
from sextant.localization.belief import Belief
from sextant.localization.estimate import Estimate, estimate
from sextant.localization.initialisation import Initialisation
from sextant.localization.motion import MotionModel
from sextant.localization.observation.evidence import Evidence, EvidenceOfSome
from sextant.localization.observers import Camera, Observer
from sextant.localization.particle_filter import FilterState, FilterStep, ParticleFilter
from sextant.shapes import check_shape

#: called with the number of a step and the belief after it
Watch = Callable[[int, Belief], None]


@dataclass(frozen=True, eq=False)
class Localized:
    """The state of r runs after a step, and what happened in it.

    Attributes:
        state: the filter's state.
        found: the estimate.
        told: the filter's step.
        moved, moves: the motion of the particles, and the model that drew it.
        learned: what was learned on the way; None without an adaptation.
    """

    state: FilterState
    found: Estimate
    told: FilterStep
    moved: Float64[Tensor, "r 3"]
    moves: MotionModel
    learned: Learned | None = None

    @property
    def belief(self) -> Belief:
        """The belief after the step."""
        return self.state.belief

    @property
    def lost(self) -> Bool[Tensor, " r"]:
        """Whether the heaviest mode holds too little weight, or recent images were not foreseen or recognised."""
        scattered, learned = self.found.mass < MODE_MASS, self.learned
        return scattered if learned is None else scattered | learned.innovation.failed | learned.unrecognised


@dataclass(frozen=True, eq=False)
class Steps:
    """The steps of a filter with its sensor; the state is passed to each.

    Attributes:
        filter: the filter, whose prior is the map's.
        start: initial distribution of the particles.
        particles: number of particles of a run, unless it adapts.
        radius: radius of the reported mode, in the unit of the map.
        adaptation: learns along the drive, and judges the belief; for a camera.
    """

    filter: ParticleFilter
    start: Initialisation
    particles: int
    radius: float
    adaptation: Adaptation | None = None

    def step(
        self,
        before: Localized | None,
        motion: Float64[Tensor, "r 3"],
        observer: Observer,
        frames: Int64[ndarray, " r"],
        seen: Bool[Tensor, "r"],
        generator: torch.Generator,
    ) -> Localized:
        """Move, observe and estimate.

        Args:
            before: the result of the previous step; None for the first.
            motion: odometry since then, nan where it is missing; particles do not move in the first step.
            observer: the sensor.
            frames: the frame of the drive that each run is at.
            seen: whether there is an image.
            generator: generator of all random numbers.
        """
        rules, filter, learned = self.adaptation, self.filter, None if before is None else before.learned
        if rules is not None:
            assert isinstance(observer, Camera)
            images, learned = observer.images(frames), learned or rules.start(len(seen))
            learned, motion = rules.believed(learned, motion, images, seen)
        if before is not None:
            seen = seen & filter.counts(before.state, motion)
        if rules is None or learned is None:
            evidence = _observed(observer, frames, seen)
        else:
            belief = None if before is None else before.belief
            learned, evidence, seen = rules.observed(learned, motion, images, seen, belief, filter.support)
            filter = replace(filter, motion=rules.motion(learned, filter.motion))
        if evidence is not None and isinstance(observer, Camera) and observer.located is not None:
            evidence = observer.located.beside(evidence, frames)
        if before is None:
            state = filter.start(self.start, len(seen), self.particles, generator, evidence, seen)
            weighed = self.start.uses_evidence and evidence is not None  # then the belief contains the first image
            state, told = filter.step(state, None, None if weighed else evidence, seen, generator)
        else:
            state, told = filter.step(before.state, motion, evidence, seen, generator)
        found = estimate(state.belief, self.radius)
        if rules is not None and learned is not None:
            off_map = torch.zeros_like(found.mass) if filter.support is None else filter.support.off_map(state.belief)
            learned = rules.after(learned, motion, found, off_map, seen & ~told.degenerate)
        return Localized(state, found, told, motion, filter.motion, learned)


@dataclass(frozen=True, eq=False)
class Track:
    """A filter's estimates of r runs in t steps.

    Attributes:
        pose: mean of the heaviest mode.
        covariance: covariance about it of 99 % of the belief (:class:`~sextant.localization.estimate.Estimate`).
        mode_covariance: covariance of the particles in that mode.
        mass: share of the weight that the mode holds.
        modes: number of modes.
        ess: effective sample size before resampling.
        particles: number of particles.
        injected: number of particles that the recovery drew anew.
        degenerate: whether no particle explained the observation in a step.
        seconds: time that each step took, for all runs together.
    """

    pose: Float64[ndarray, "t r 3"]
    covariance: Float64[ndarray, "t r 3 3"]
    mode_covariance: Float64[ndarray, "t r 3 3"]
    mass: Float64[ndarray, "t r"]
    modes: Int64[ndarray, "t r"]
    ess: Float64[ndarray, "t r"]
    particles: Int64[ndarray, "t r"]
    injected: Int64[ndarray, "t r"]
    degenerate: Bool[ndarray, "t r"]
    seconds: Float64[ndarray, "t"]


def localize(
    filter: ParticleFilter,
    start: Initialisation,
    observer: Observer,
    frames: Int64[ndarray, "t r"],
    motion: Float64[ndarray, "t r 3"],
    seen: Bool[ndarray, "t r"],
    generator: torch.Generator,
    *,
    particles: int,
    radius: float,
    adaptation: Adaptation | None = None,
    watch: Watch | None = None,
) -> Track:
    """Run a filter along runs, step by step.

    Args:
        filter: the filter, whose prior is the map's.
        start: initial distribution of the particles.
        observer: the sensor.
        frames: the frame of the drive that each run is at in each step.
        motion: odometry since the previous step, nan where it is missing; that of the first step moves no particle.
        seen: whether there is an image.
        generator: generator of all random numbers.
        particles: number of particles of a run, unless it adapts.
        radius: radius of the reported mode, in the unit of the map.
        adaptation: learns along the drive, for a camera; None for a filter that does not adapt.
        watch: called with every step and the belief after it.

    Raises:
        ArgumentError: there is not one motion, and one value of ``seen``, for each of the frames.

    Example:
        >>> from sextant.localization import initialisation, map_prior, motion, recovery, resampling
        >>> from sextant.localization.laser.scan_evidence import ScanEvidence
        >>> class Metres(Observer):  # frame k matches the place at k metres
        ...     observe = lambda self, frames: ScanEvidence(lambda at: -10 * (at[..., 0] - frames[:, None]) ** 2, line)
        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(10)], dtype=torch.float64)
        >>> moves, prior = motion.ExponentialMotion(), map_prior.MapPrior(line, 0.5, 0.1)
        >>> filter = ParticleFilter(moves, resampling.SystematicResampling(), recovery.NoRecovery(), prior)
        >>> start, draws = initialisation.UniformStart(), torch.Generator().manual_seed(0)  # anywhere on the map
        >>> frames, steps = np.array([[2], [3], [4]]), np.tile([1.0, 0.0, 0.0], (3, 1, 1))  # a metre ahead each time
        >>> track = localize(filter, start, Metres(), frames, steps, frames > 0, draws, particles=1000, radius=1.0)
        >>> track.pose[:, 0, 0].round()
        array([2., 3., 4.])
    """
    check_shape("motion", motion, *frames.shape, 3)
    check_shape("seen", seen, *frames.shape)
    steps, seconds = Steps(filter, start, particles, radius, adaptation), np.zeros(len(frames))
    now: Localized | None = None
    columns: dict[str, list[Tensor]] = {}
    for step in range(len(frames)):
        began = time.perf_counter()
        moved, looked = torch.from_numpy(motion[step]), torch.from_numpy(seen[step])
        now = steps.step(now, moved, observer, frames[step], looked, generator)
        seconds[step] = time.perf_counter() - began
        for name in ("pose", "covariance", "mode_covariance", "mass", "modes"):
            columns.setdefault(name, []).append(getattr(now.found, name))
        for name in ("ess", "particles", "injected", "degenerate"):
            columns.setdefault(name, []).append(getattr(now.told, name))
        if watch is not None:
            watch(step, now.belief)
    return Track(**{name: torch.stack(values).numpy() for name, values in columns.items()}, seconds=seconds)


def _observed(observer: Observer, frames: Int64[ndarray, " r"], looked: Bool[Tensor, "r"]) -> Evidence | None:
    """The evidence of the runs in ``looked``; None if there is none."""
    if bool(looked.all()):
        return observer.observe(frames)
    if not bool(looked.any()):
        return None
    return EvidenceOfSome(observer.observe(frames[looked.numpy()]), looked)
