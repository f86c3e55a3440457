"""A step of the particle filter: against ten times the particles, a loop over particles, and a map of 172,000 images.

Tasks alternate, so that all run under the same load, and ratios are of the medians of one run. The observation is a
cheap function of the pose, so that the filter itself is timed; observation models have benchmarks of their own.
"""

import math
import random
from collections.abc import Callable

import torch

from benchmarks.push_pull_timing import medians
from sextant.localization.estimate import estimate
from sextant.localization.initialisation import UniformStart
from sextant.localization.map_prior import MapPrior
from sextant.localization.motion import ExponentialMotion
from sextant.localization.observation.evidence import Evidence
from sextant.localization.particle_filter import FilterState, ParticleFilter
from sextant.localization.recovery import BayesRestart, NoRecovery, Recovery
from sextant.localization.resampling import SystematicResampling

IMAGES, REPEATS = 172_000, 41
SIGMAS = (0.025, 0.01, 0.015)

Row = tuple[str, str, str, str, str]


class Distances(Evidence):
    """A likelihood that falls with the distance from one place, and any other over the map."""

    def __init__(self, images: int):
        self.over = -0.5 * (5 * torch.randn(1, images, generator=generator(), dtype=torch.float64)).abs()

    def log_likelihood(self, poses: torch.Tensor) -> torch.Tensor:
        return -0.005 * poses[..., :2].square().sum(2)

    def over_map(self) -> torch.Tensor:
        return self.over


def run(images: int = IMAGES, repeats: int = REPEATS) -> list[Row]:
    prior = MapPrior(1000 * torch.rand(images, 3, generator=generator(), dtype=torch.float64), 1.0, 0.1)
    evidence = Distances(images)
    works: dict[str, Callable[[], object]] = {}
    for particles in (1000, 4000, 10_000):
        works[f"move {particles}"] = step(prior, particles, NoRecovery(), None)
        works[f"weigh {particles}"] = step(prior, particles, NoRecovery(), evidence)
        works[f"restart {particles}"] = step(prior, particles, BayesRestart(), evidence)
    works["estimate"] = estimating(prior, 1000)
    works["loop"] = loop(10_000)
    milliseconds = {name: 1e3 * seconds for name, seconds in medians(works, repeats).items()}

    def row(what: str, name: str, against: str, aim: str) -> Row:
        ours, other = milliseconds[name], milliseconds[against]
        return what, f"{ours:.2f} ms", f"{against} {other:.2f} ms", f"{ours / other:.2f}", aim

    return [
        row("step without observation, 10,000 particles", "move 10000", "move 1000", "<= 10"),
        row("step with motion, weights, resampling, 10,000", "weigh 10000", "weigh 1000", "<= 10"),
        row(f"the same and restarts among {images:,} images", "restart 10000", "restart 1000", "<= 10"),
        row("what restarts add at 1,000 particles", "restart 1000", "weigh 1000", ""),
        row("motion, weights, resampling against a Python loop", "weigh 10000", "loop", "< 1"),
        row("estimate of 1,000 particles", "estimate", "weigh 1000", ""),
        straight(milliseconds),
    ]


def step(prior: MapPrior, particles: int, recovery: Recovery, evidence: Evidence | None) -> Callable[[], object]:
    """One step from the same state, repeatedly; with an observation, it resamples each time."""
    particle_filter = ParticleFilter(
        ExponentialMotion(SIGMAS), SystematicResampling(), recovery, prior, ess_threshold=1.0 if evidence else 0.5
    )
    rng, motion = generator(), torch.tensor([[0.5, 0.0, 0.02]], dtype=torch.float64)
    state: FilterState = particle_filter.start(UniformStart(), 1, particles, rng)
    return lambda: particle_filter.step(state, motion, evidence, None, rng)


def estimating(prior: MapPrior, particles: int) -> Callable[[], object]:
    near = MapPrior(prior.poses[:1], 1.0, 0.1)
    belief = UniformStart().start(near, 1, particles, None, None, generator())
    return lambda: estimate(belief, 2.0)


def loop(particles: int) -> Callable[[], object]:
    """A filter of plain Python objects: motion, weight and systematic resampling, one after the other."""
    rng = random.Random(0)
    cloud = [(rng.uniform(0, 1000), rng.uniform(0, 1000), rng.uniform(-3, 3)) for _ in range(particles)]

    def work() -> object:
        moved, weights = [], []
        for x, y, heading in cloud:
            along, across, turn = (rng.gauss(0, sigma) for sigma in SIGMAS)
            cosine, sine = math.cos(heading), math.sin(heading)
            to_x = x + (0.5 + along) * cosine - across * sine
            to_y = y + (0.5 + along) * sine + across * cosine
            moved.append((to_x, to_y, heading + 0.02 + turn))
            weights.append(-0.005 * (to_x * to_x + to_y * to_y))
        best = max(weights)
        weights = [math.exp(weight - best) for weight in weights]
        pace = sum(weights) / particles
        target, reached, index, chosen = rng.random() * pace, weights[0], 0, []
        for _ in range(particles):
            while reached < target and index < particles - 1:
                index += 1
                reached += weights[index]
            chosen.append(moved[index])
            target += pace
        return chosen

    return work


def straight(milliseconds: dict[str, float]) -> Row:
    """The time at 4,000 particles relative to the line through 1,000 and 10,000."""
    few, some, many = (milliseconds[f"weigh {particles}"] for particles in (1000, 4000, 10_000))
    line = few + (many - few) * 3 / 9
    return (
        "step with 4,000 particles",
        f"{some:.2f} ms",
        f"line 1,000-10,000 {line:.2f} ms",
        f"{some / line:.2f}",
        "~ 1",
    )


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)
