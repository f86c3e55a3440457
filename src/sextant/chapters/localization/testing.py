"""Localization of the test drives: with each fault, along each drive, with each number of particles."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from torch import Tensor

from sextant.chapters.localization.data.drive import Drive, LocalizationData
from sextant.chapters.localization.data.faults import Fault, WrongStart
from sextant.chapters.localization.validation import protocol_of
from sextant.evaluation.pose_posterior import particle_nll
from sextant.evaluation.protocols import LocalizationProtocol
from sextant.geometry.planar import se2_compose
from sextant.localization.adaptation import Adaptation
from sextant.localization.belief import Belief
from sextant.localization.initialisation import AppearanceStart, GaussianStart, Initialisation, UniformStart
from sextant.localization.interpolated_retrieval import interpolated
from sextant.localization.localize import Track, localize
from sextant.localization.map_prior import MapPrior
from sextant.localization.map_support import MapSupport, heading_reach, map_spacing
from sextant.localization.motion import MotionModel
from sextant.localization.observers import Camera, Observer
from sextant.localization.particle_filter import ParticleFilter
from sextant.localization.pose_kernel import PoseKernel
from sextant.localization.recovery import BayesRestart, MetricProposal, NoRecovery, Recovery
from sextant.localization.resampling import Resampling
from sextant.reporter import Advance
from sextant.tables import counted


@dataclass(frozen=True, eq=False)
class TestRuns:
    """Runs side by side, step by step. Runs that end early are padded with their last frame, which is not ``seen``.

    Attributes:
        frames: frames of the drive, which index descriptors and scans.
        poses: ground truth.
        motion: odometry; nan where it is missing.
        seen: whether the frame may be used.
        lengths: number of steps of each run.
        kidnapped_at: the step at which each run is kidnapped; -1 for none.
    """

    __test__ = False  # not a test of pytest's

    frames: Int64[ndarray, "t r"]
    poses: Float64[ndarray, "t r 3"]
    motion: Float64[ndarray, "t r 3"]
    seen: Bool[ndarray, "t r"]
    lengths: Int64[ndarray, "r"]
    kidnapped_at: Int64[ndarray, "r"]

    @property
    def inside(self) -> Bool[ndarray, "t r"]:
        """Whether a step belongs to a run."""
        return np.asarray(np.arange(len(self.frames))[:, None] < self.lengths)


def lay_out_runs(drive: Drive, fault: Fault, starts: int, horizon: int, every: int, seed: int) -> TestRuns:
    """Runs that start at frames evenly spaced over a drive.

    Args:
        drive: the drive to localize.
        fault: applied to each run, with its own random numbers.
        starts: number of runs.
        horizon: steps of each run, or fewer if the drive ends. The last run starts early enough for ``horizon`` steps
            if the drive has that many.
        every: frames from one step to the next.
        seed: of the faults.
    """
    begins = np.round(np.linspace(0, max(0, len(drive) - horizon * every), starts)).astype(np.int64)
    runs = [_run_of(drive, fault, int(begin), horizon, every, [seed, 82, k]) for k, begin in enumerate(begins)]
    steps = max(len(run) for run, _ in runs)
    return TestRuns(
        _side_by_side([frames for _, frames in runs], steps),
        _side_by_side([run.poses for run, _ in runs], steps),
        _side_by_side([_motion(run) for run, _ in runs], steps, 0.0),
        _side_by_side([run.seen for run, _ in runs], steps, False),
        np.array([len(run) for run, _ in runs]),
        np.array([run.kidnaps[0] if run.kidnaps else -1 for run, _ in runs]),
    )


def _run_of(
    drive: Drive, fault: Fault, begin: int, horizon: int, every: int, seed: Sequence[int]
) -> tuple[Drive, Int64[ndarray, "t"]]:
    """One run with its fault, and the frames of the drive that it consists of."""
    run = fault.drive(drive.select(begin, begin + horizon * every, every), np.random.default_rng(seed), drive)
    return run, np.searchsorted(drive.frames, run.frames)


def _motion(run: Drive) -> ndarray:
    return np.full((len(run), 3), np.nan) if run.motion is None else run.motion


def _side_by_side(columns: Sequence[ndarray], steps: int, last: object = None) -> ndarray:
    """Stack columns side by side; shorter ones are padded with their last value, or with ``last``."""
    padded = []
    for column in columns:
        rest = np.repeat(column[-1:], steps - len(column), axis=0)
        padded.append(np.concatenate([column, rest if last is None else np.full_like(rest, last)]))
    return np.stack(padded, axis=1)


#: bandwidth of the particles' kernel density estimate, in limits of the protocol
BANDWIDTH = 0.25
#: share of the uniform density in that estimate
BACKGROUND = 1e-3


@dataclass(frozen=True)
class Trial:
    """One combination that is tested.

    Attributes:
        drive: the drive that is localized.
        fault: name of the fault.
        particles: number of particles in each run.
        corruption: key of the image corruption; empty for images as they are.
    """

    drive: str
    condition: str
    fault: str
    particles: int
    corruption: str = ""


@dataclass(frozen=True, eq=False)
class Outcome:
    """The runs of one trial.

    Attributes:
        trial: what was tested.
        runs: the runs with their ground truth.
        track: the filter's estimates.
        nll: negative log-likelihood of the true pose at each step, in nats.
        replay: particles and weights of the first run, step by step, if they were kept.
    """

    trial: Trial
    runs: TestRuns
    track: Track
    nll: Float64[ndarray, "t r"]
    replay: list[tuple[ndarray, ndarray]]


@dataclass(frozen=True)
class TestSettings:
    """How drives are localized.

    Attributes:
        motion, recovery, resampling: parts of the filter.
        ess_threshold: threshold of the filter.
        kld: adapts the filter's number of particles.
        start: initial distribution of the particles.
        particle_counts: numbers of particles, tested one after the other.
        starts, horizon, every: arguments of :func:`~sextant.chapters.localization.testing.lay_out_runs`.
        spread: standard deviations of poses around an image of the map: along, across, and in rad.
        seed: seed of all random numbers.
        replay: keep the particles of the first run of each trial.
        support: distance from the map's images within which the observation model is evaluated; ``map``: from the map
            and its kernel; None: everywhere. See :class:`~sextant.localization.map_support.MapSupport`.
        outliers: share of images that carry no information about their pose; None: 1 % with ``support``, 0 without.
        apart: motion, in spacings of the map, after which the next image is used; None: every image is used.
        best: number of most similar images whose poses are averaged instead of filtering; None: filtering.
        adapts: whether the filter adapts to the drive (:mod:`sextant.localization.adaptation`), for a camera.
        odds: with ``adapts``, the scale of one image's evidence; None: that of the likelihood.
        proposes: whether particles are drawn around located poses, too.
    """

    __test__ = False

    motion: MotionModel
    recovery: Recovery
    resampling: Resampling
    ess_threshold: float
    kld: object
    start: str
    particle_counts: tuple[int, ...]
    starts: int
    horizon: int
    every: int
    spread: tuple[float, float, float]
    seed: int
    replay: bool = False
    support: float | Literal["map"] | None = None
    outliers: float | None = None
    apart: float | None = None
    best: int | None = None
    adapts: bool = False
    odds: float | None = None
    proposes: bool = False

    def filter(self, poses: Float64[Tensor, "n 3"], kernel: PoseKernel | None = None) -> ParticleFilter:
        """The filter on a map of images at these poses, with the kernel learnt for it."""
        support = None if self.support is None else MapSupport.of(poses, kernel)
        if support is not None and isinstance(self.support, int | float):
            support = replace(support, reach=self.support)
        if self.outliers is not None:
            support = replace(support or MapSupport.everywhere(poses, self.outliers), outliers=self.outliers)
        apart = None if self.apart is None else (self.apart * map_spacing(poses), 2 * heading_reach(poses) * self.apart)
        recovery = self.recovery
        if self.proposes:
            assert isinstance(recovery, BayesRestart | NoRecovery)
            recovery = MetricProposal(recovery)
        return ParticleFilter(
            self.motion,
            self.resampling,
            recovery,
            MapPrior(poses, self.spread[:2], self.spread[2]),
            ess_threshold=self.ess_threshold,
            kld=self.kld,  # type: ignore[arg-type]
            support=support,
            apart=apart,
        )


#: fits a map and returns a function that makes the sensor of a drive; called with the map before and after a fault
MakeObservers = Callable[[Drive, Drive], Callable[[Drive], Observer]]


def run_trials(
    drives: LocalizationData,
    faults: Mapping[str, Fault],
    settings: TestSettings,
    make_observers: MakeObservers,
    progress: Advance | None = None,
    kernel: PoseKernel | None = None,
) -> Iterator[Outcome]:
    """Localize every test drive, as it is and corrupted, with every fault and number of particles.

    Args:
        drives: data whose test drives are localized.
        faults: faults by name.
        settings: settings of the filter and of the runs.
        make_observers: see :data:`MakeObservers`.
        progress: called with the number of trials done and the total.
        kernel: the learnt kernel, for a camera.
    """
    total = len(faults) * len((*drives.test, *drives.corrupted)) * len(settings.particle_counts)
    done = 0
    for number, (name, fault) in enumerate(faults.items()):
        changed = fault.data(drives)
        faulty = fault.map(changed.map, np.random.default_rng([settings.seed, 83, number]))
        observer_of = make_observers(changed.map, faulty)
        filter = settings.filter(torch.from_numpy(faulty.poses), kernel)
        for drive in (*changed.test, *changed.corrupted):
            runs = _laid_out(drive, fault, settings, number)
            observer = observer_of(drive)
            watched = replace(settings, replay=False) if drive.corruption else settings
            for particles in settings.particle_counts:
                trial = Trial(drive.name, drive.condition, name, particles, drive.corruption)
                yield _one(trial, changed, runs, fault, observer, filter, watched)
                done += 1
                if progress:
                    progress(done, total)


def check_runs(data: LocalizationData, faults: Mapping[str, Fault], settings: TestSettings) -> None:
    """Lay out all runs, so that a mistake is reported before anything is trained.

    Raises:
        UserError: a fault does not fit the dataset or a run.
    """
    for number, fault in enumerate(faults.values()):
        for drive in fault.data(data).test:
            _laid_out(drive, fault, settings, number)


def short_drives(drives: Sequence[Drive], settings: TestSettings) -> list[str]:
    """Notes on drives that are too short for runs of ``horizon`` steps from the requested number of frames."""
    notes = []
    for drive in drives:
        begins = min(settings.starts, max(0, len(drive) - settings.horizon * settings.every) + 1)
        if begins < settings.starts:
            steps = min(settings.horizon, -(-len(drive) // settings.every))
            notes.append(
                f"task.horizon={settings.horizon} task.every={settings.every}: {drive.name} has "
                f"{counted(len(drive), 'frame')}, so its {settings.starts} runs of {steps} steps start at only "
                f"{begins} of them; runs from the same frame differ only in their random numbers"
            )
    return notes


def _laid_out(drive: Drive, fault: Fault, settings: TestSettings, number: int) -> TestRuns:
    """The runs along a drive with the fault of that number."""
    return lay_out_runs(drive, fault, settings.starts, settings.horizon, settings.every, settings.seed + 1000 * number)


def _one(
    trial: Trial,
    data: LocalizationData,
    runs: TestRuns,
    fault: Fault,
    observer: Observer,
    filter: ParticleFilter,
    settings: TestSettings,
) -> Outcome:
    protocol = protocol_of(data)
    volume = _volume(protocol, filter.prior)
    generator = torch.Generator().manual_seed(settings.seed * 7919 + trial.particles)
    nll, replay = np.full(runs.seen.shape, np.nan), list[tuple[ndarray, ndarray]]()

    def watch(step: int, belief: Belief) -> None:
        nll[step] = _nll(runs.poses[step], belief, protocol, volume)
        if settings.replay:
            replay.append((belief.poses[0].numpy().astype(np.float32), belief.weights[0].numpy().astype(np.float32)))

    seen = runs.seen & runs.inside
    rules = None
    if settings.adapts:
        assert isinstance(observer, Camera)
        rules = Adaptation(observer.model, observer.likelihood, odds=settings.odds)
    if settings.best is not None:
        assert isinstance(observer, Camera)
        best, radius = settings.best, protocol.position * 2
        track = interpolated(observer, runs.frames, runs.motion, seen, best=best, radius=radius, watch=watch)
    else:
        track = localize(
            filter,
            _start(settings, runs, fault, protocol, generator),
            observer,
            runs.frames,
            runs.motion,
            seen,
            generator,
            particles=trial.particles,
            radius=protocol.position * 2,
            adaptation=rules,
            watch=watch,
        )
    return Outcome(trial, runs, track, np.where(runs.inside, nll, np.nan), replay)


def _start(
    settings: TestSettings,
    runs: TestRuns,
    fault: Fault,
    protocol: LocalizationProtocol,
    generator: torch.Generator,
) -> Initialisation:
    truth = torch.from_numpy(runs.poses[0])
    turn = 0.0 if protocol.heading_deg is None else math.radians(protocol.heading_deg) / 2
    across = 0.0 if protocol.unit == "frames" else protocol.position / 2
    sigma = (protocol.position / 2, across, turn)
    if isinstance(fault, WrongStart):
        return GaussianStart(_displaced(truth, fault, protocol, generator), sigma)
    if settings.start == "gaussian":
        noise = torch.randn(truth.shape, generator=generator, dtype=truth.dtype) * truth.new_tensor(sigma)
        return GaussianStart(se2_compose(truth, noise), sigma)
    return AppearanceStart() if settings.start == "appearance" else UniformStart()


def _displaced(
    truth: torch.Tensor, fault: WrongStart, protocol: LocalizationProtocol, generator: torch.Generator
) -> torch.Tensor:
    """Poses at the fault's distance, in directions drawn at random; on a railway ahead or behind."""
    draws = torch.rand(len(truth), 2, generator=generator, dtype=truth.dtype)
    side = torch.where(draws[:, 1] < 0.5, -1.0, 1.0)
    direction = torch.where(side < 0, math.pi, 0.0) if protocol.unit == "frames" else 2 * math.pi * draws[:, 0]
    turn = 0.0 * side if protocol.heading_deg is None else math.radians(fault.heading_deg) * side
    moved = fault.distance * torch.stack([direction.cos(), direction.sin()], dim=1)
    return torch.cat([truth[:, :2] + moved, (truth[:, 2] + turn)[:, None]], dim=1)


def _volume(protocol: LocalizationProtocol, prior: MapPrior) -> float:
    """The volume of the poses about a map: its length along a railway, otherwise its area times 2π."""
    low, high = prior.poses[:, :2].amin(0), prior.poses[:, :2].amax(0)
    sides = (high - low + 2 * protocol.position).tolist()
    return float(sides[0] if protocol.unit == "frames" else sides[0] * sides[1] * 2 * math.pi)


def _nll(truth: ndarray, belief: Belief, protocol: LocalizationProtocol, volume: float) -> ndarray:
    """The NLL of the true pose under a kernel density of the particles, bounded by a uniform one over the map."""
    return particle_nll(
        truth,
        belief.poses.numpy(),
        belief.log_weights.numpy(),
        bandwidth_m=BANDWIDTH * protocol.position,
        bandwidth_rad=math.radians(BANDWIDTH * (protocol.heading_deg or 40.0)),
        axes=(0,) if protocol.unit == "frames" else (0, 1, 2),
        background=BACKGROUND,
        background_density=1 / volume,
    )
