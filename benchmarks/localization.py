"""A whole step of the particle filter in a city of 172,000 images: motion, image, restart, resampling, estimate.

The whole step after the image is described is timed: its product with the map, the particles' likelihoods,
the evidence over the map that restarts are drawn from, thinning, resampling and the estimate. The city is streets on a
grid with images of eight headings, and its descriptors are a smooth random function of the pose, so that restarts and
weights are those of a filter that works. Particles are anywhere in the city, as after a global start, with the least
cache locality; or around one place, as when tracking. Tasks alternate, so that all run under the same load, each cycles
through several clouds and images, and ratios are of the medians of one run on one thread.
"""

import math
from collections.abc import Callable
from itertools import cycle
from resource import RUSAGE_SELF, getrusage

import numpy as np
import torch

from benchmarks.push_pull_timing import medians
from benchmarks.retrieval import Row
from sextant.localization.constants import WINDOW
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.estimate import estimate
from sextant.localization.initialisation import UniformStart
from sextant.localization.likelihood import Likelihood
from sextant.localization.map_prior import MapPrior
from sextant.localization.motion import ExponentialMotion
from sextant.localization.observation.cached_local_gp import CachedEvidence, CachedLocalGP
from sextant.localization.particle_filter import FilterState, ParticleFilter
from sextant.localization.pose_kernel import PoseKernel
from sextant.localization.recovery import BayesRestart, NoRecovery, Recovery
from sextant.localization.resampling import SystematicResampling

COUNT, SMALLER, DIMENSION, NEIGHBOURS, REPEATS = 172_000, 43_000, 128, 16, 31
PARTICLES = (1000, 2000, 4000, 6000, 8000, 10_000)
#: Metres between images along a street and between streets, and images of one place.
ALONG, BLOCK, HEADINGS = 10.0, 80.0, 8
#: Length scales in metres and in chords of the circle.
LENGTH, HEADING_LENGTH, NOISE_SHARE = 8.0, 0.7, 0.2
KERNEL = PoseKernel("rbf", (LENGTH, LENGTH), HEADING_LENGTH, (1 - NOISE_SHARE) / DIMENSION, NOISE_SHARE / DIMENSION)
LIKELIHOOD = Likelihood(tempering=0.25)
#: Clouds of particles, each with an image, that a task cycles through.
CLOUDS, RADIUS = 4, 5.0
WAVES = 256


def run(count: int = COUNT, repeats: int = REPEATS) -> list[Row]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return _run(count, repeats)
    finally:
        torch.set_num_threads(threads)


def _run(count: int, repeats: int) -> list[Row]:
    by_image = CachedLocalGP(NEIGHBOURS, map_evidence="image").fit(city(count), KERNEL)
    by_mean = CachedLocalGP(NEIGHBOURS, map_evidence="mean").load_state(by_image.map, KERNEL, by_image.state())
    rounded = CachedLocalGP(NEIGHBOURS, map_evidence="mean", rounded=True)
    rounded.load_state(by_image.map, KERNEL, by_image.state())
    smaller = CachedLocalGP(NEIGHBOURS, map_evidence="mean").fit(city(count * SMALLER // COUNT), KERNEL)
    rows, query = by_image.map.descriptors.numpy(), by_image.map.descriptors[0].numpy().copy()
    tensor, vector = by_image.map.descriptors, torch.from_numpy(query)
    works: dict[str, Callable[[], object]] = {
        "numpy product": lambda: rows @ query,
        "torch product": lambda: torch.mv(tensor, vector),
        "means, one place": step(by_mean, 1000, spread=False),
        "images, one place": step(by_image, 1000, spread=False),
        "images": step(by_image, 1000),
        "window": step(by_image, 1000, BayesRestart(window=WINDOW)),
        "observe": observing(by_mean),
        "observe rounded": observing(rounded),
        "rounded": step(rounded, 1000),
        "restart": step(by_mean, 1000, given=True),
        "given, all": step(by_mean, 1000, NoRecovery(), given=True),
        "given, fewer": step(smaller, 1000, NoRecovery(), given=True),
        "whole, fewer": step(smaller, 1000),
    }
    works |= {f"means {particles}": step(by_mean, particles) for particles in PARTICLES}
    seconds = medians(works, repeats)
    fastest = min(("numpy product", "torch product"), key=seconds.__getitem__)

    def row(what: str, name: str, against: str, aim: str) -> Row:
        ours, other = seconds[name], seconds[against]
        return what, f"{1e3 * ours:.2f} ms", f"{against} {1e3 * other:.2f} ms", f"{ours / other:.2f}", aim

    what = f"1,000 particles, {count:,} x {DIMENSION}, k={NEIGHBOURS}"
    return [
        row(f"whole step, map_evidence=image: {what}", "images", fastest, "<= 3"),
        row("whole step, map_evidence=mean", "means 1000", fastest, "<= 3"),
        row("whole step, particles at one place, image", "images, one place", fastest, "<= 3"),
        row("whole step, particles at one place, mean", "means, one place", fastest, "<= 3"),
        row(f"whole step, restarts by {WINDOW} images more", "window", "images", ""),
        row("of it the product", "observe", fastest, ""),
        row("of it the product, descriptors rounded to eight bits", "observe rounded", "observe", ""),
        row("whole step, mean, descriptors rounded to eight bits", "rounded", "means 1000", ""),
        row("whole step but the product, mean", "restart", fastest, ""),
        row("whole step, 10,000 particles", "means 10000", "means 1000", "<= 10"),
        _linear(seconds),
        row(
            f"step without restart, product given: {count * SMALLER // COUNT:,} images",
            "given, fewer",
            "given, all",
            "~ 1",
        ),
        row(f"whole step: {count * SMALLER // COUNT:,} images", "whole, fewer", "means 1000", ""),
        ("peak memory", f"{getrusage(RUSAGE_SELF).ru_maxrss / 2**20:.2f} GiB", "", "", "<= 2.33 GiB"),
    ]


def step(
    model: CachedLocalGP, particles: int, recovery: Recovery | None = None, *, spread: bool = True, given: bool = False
) -> Callable[[], object]:
    """One step from each cloud in turn, with weights that cause resampling.

    Args:
        model: model of the city.
        particles: size of the cloud.
        recovery: restarts by default.
        spread: particles anywhere in the city, not around the place of the image.
        given: the product with the map is precomputed.
    """
    rng, motion = _generator(), torch.tensor([[0.5, 0.0, 0.02]], dtype=torch.float64)
    everywhere = MapPrior(model.map.poses, 2.0, 0.1)
    particle_filter = ParticleFilter(
        ExponentialMotion((0.1, 0.05, 0.02)), SystematicResampling(), recovery or BayesRestart(), everywhere,
        ess_threshold=1.0,
    )  # fmt: skip
    clouds = []
    for place in torch.randint(len(model.map), (CLOUDS,), generator=rng).tolist():
        prior = everywhere if spread else MapPrior(model.map.poses[place : place + 1], 2.0, 0.1)
        belief = UniformStart().start(prior, 1, particles, None, None, rng)
        image = model.map.descriptors[place : place + 1] + 0.02 * torch.randn(1, DIMENSION, generator=rng)
        state = FilterState(belief, particle_filter.recovery.memory(1), torch.full((1,), math.inf).double())
        for _ in range(getattr(recovery, "window", 0)):
            seen, _ = particle_filter.step(state, motion, model.observe(image, LIKELIHOOD), None, rng)
            state = FilterState(belief, seen.memory, seen.way)
        clouds.append((state, image, model.observe(image, LIKELIHOOD) if given else None))
    turns = cycle(clouds)

    def work() -> object:
        state, image, evidence = next(turns)
        evidence = model.observe(image, LIKELIHOOD) if evidence is None else evidence
        after, _ = particle_filter.step(state, motion, evidence, None, rng)
        return estimate(after.belief, RADIUS)

    return work


def observing(model: CachedLocalGP) -> Callable[[], CachedEvidence]:
    """The cost of an image that does not depend on the particles."""
    image = model.map.descriptors[:1].clone()
    return lambda: model.observe(image, LIKELIHOOD)


def city(count: int) -> DescriptorMap:
    """Images of a city with descriptors that change smoothly over it."""
    poses, describe = city_poses(count), smooth(np.random.default_rng(0))
    return DescriptorMap.of(poses, torch.cat([describe(some) for some in poses.split(8192)]))


def city_poses(count: int) -> torch.Tensor:
    """Streets on a square grid, images of eight headings every ten metres."""
    random = np.random.default_rng(1)
    places = -(-count // HEADINGS)
    ground = streets(places) + random.normal(0, 0.5, (places, 2))
    heading = np.tile(2 * math.pi / HEADINGS * np.arange(HEADINGS) - math.pi, places)
    poses = np.concatenate([ground.repeat(HEADINGS, axis=0), heading[:, None]], axis=1)[:count]
    poses[:, 2] += random.normal(0, 0.05, count)
    return torch.from_numpy(poses)


def streets(places: int) -> np.ndarray:
    """The first places of a town whose streets form square blocks, block by block."""
    steps = int(BLOCK / ALONG)
    blocks = math.ceil(math.sqrt(places / (2 * steps)))
    offset = ALONG * np.arange(steps)
    eastward = np.stack([offset, np.zeros(steps)], axis=1)
    corner = np.concatenate([eastward, eastward[:, ::-1]])
    column, row = np.divmod(np.arange(blocks * blocks), blocks)
    corners = BLOCK * np.stack([column, row], axis=1)
    # the crossing itself is on both streets: half a step further on one of them
    corner[steps:, 1] += ALONG / 2
    places_of_blocks: np.ndarray = (corners[:, None] + corner).reshape(-1, 2)
    return places_of_blocks[:places]


def smooth(random: np.random.Generator) -> Callable[[torch.Tensor], torch.Tensor]:
    """Describes poses by a draw of the kernel's own prior, made of random waves, with noise; norms are about one."""
    frequency, phase = random.normal(size=(4, WAVES)), random.uniform(0, 2 * math.pi, WAVES)
    mixture = random.normal(size=(WAVES, DIMENSION)) * math.sqrt(2 * KERNEL.signal_variance / WAVES)

    def describe(poses: torch.Tensor) -> torch.Tensor:
        waves = np.cos(KERNEL.features(poses).numpy() @ frequency + phase).astype(np.float32)
        descriptors = waves @ mixture.astype(np.float32)
        noise = random.standard_normal(descriptors.shape, dtype=np.float32)
        return torch.from_numpy(descriptors + noise * np.float32(math.sqrt(KERNEL.noise_variance)))

    return describe


def _linear(seconds: dict[str, float]) -> Row:
    """The linearity of time in the number of particles."""
    particles = np.array(PARTICLES, float)
    times = np.array([seconds[f"means {number}"] for number in PARTICLES])
    slope, level = np.polyfit(particles, times, 1)
    left = np.square(times - (slope * particles + level)).sum() / np.square(times - times.mean()).sum()
    told = f"{1e3 * level:.2f} ms + {1e6 * slope:.2f} us per particle"
    return f"line through {len(PARTICLES)} sizes, 1,000 to 10,000", told, "", f"R^2 {1 - left:.4f}", "> 0.98"


def _generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)
