"""Running a particle filter along whole runs, many at once."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from torch import Tensor

from sextant.localization.belief import Belief
from sextant.localization.estimate import estimate
from sextant.localization.initialisation import Initialisation
from sextant.localization.observation.evidence import Evidence, EvidenceOfSome
from sextant.localization.observers import Observer
from sextant.localization.particle_filter import FilterState, ParticleFilter
from sextant.reporter import Advance

#: called with the number of a step and the belief after it
Watch = Callable[[int, Belief], None]


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
    watch: Watch | None = None,
    progress: Advance | None = None,
) -> Track:
    """Run a filter along runs, step by step.

    Args:
        filter: the filter, whose prior is the map's.
        start: initial distribution of the particles.
        observer: the sensor.
        frames: the frame of the drive that each run is at in each step.
        motion: odometry since the previous step; that of the first step is not used.
        seen: whether there is an image.
        generator: generator of all random numbers.
        particles: number of particles of a run, unless it adapts.
        radius: radius of the reported mode, in the unit of the map.
        watch: called with every step and the belief after it.
        progress: called with the number of steps done and of all.

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
    steps = len(frames)
    columns: dict[str, list[Tensor]] = {}
    seconds = np.zeros(steps)
    state: FilterState | None = None
    for step in range(steps):
        began = time.perf_counter()
        moved = None if state is None else torch.from_numpy(motion[step])
        looked = torch.from_numpy(seen[step])
        if state is not None:
            looked = looked & filter.counts(state, moved)
        evidence = _observed(observer, frames[step], looked)
        if state is None:
            state = filter.start(start, frames.shape[1], particles, generator, evidence, looked)
            weighed = start.uses_evidence and evidence is not None  # then the belief contains the first image
            state, told = filter.step(state, None, None if weighed else evidence, looked, generator)
        else:
            state, told = filter.step(state, moved, evidence, looked, generator)
        found = estimate(state.belief, radius)
        seconds[step] = time.perf_counter() - began
        for name in ("pose", "covariance", "mode_covariance", "mass", "modes"):
            columns.setdefault(name, []).append(getattr(found, name))
        for name in ("ess", "particles", "injected", "degenerate"):
            columns.setdefault(name, []).append(getattr(told, name))
        if watch is not None:
            watch(step, state.belief)
        if progress is not None:
            progress(step + 1, steps)
    return Track(**{name: torch.stack(values).numpy() for name, values in columns.items()}, seconds=seconds)


def _observed(observer: Observer, frames: Int64[ndarray, " r"], looked: Bool[Tensor, "r"]) -> Evidence | None:
    """The evidence of the runs in ``looked``; None if there is none."""
    if bool(looked.all()):
        return observer.observe(frames)
    if not bool(looked.any()):
        return None
    return EvidenceOfSome(observer.observe(frames[looked.numpy()]), looked)
