"""The local Gaussian process: one solve per particle by scikit-learn against ours, and a whole observation in a city.

A city of 172,000 images at street level: panoramas along streets, each cut into images of several headings. Tasks
alternate, so that all run under the same load, and ratios are of the medians of one run. Agreement of both is checked
first.
"""

import time
import warnings
from collections.abc import Callable

import numpy as np
import torch

from benchmarks.push_pull_timing import medians
from benchmarks.retrieval import Row, traverse
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation.cached_local_gp import CachedLocalGP
from sextant.localization.observation.local_gp import LocalGP
from sextant.localization.pose_kernel import PoseKernel

COUNT, DIMENSION, NEIGHBOURS, PARTICLES, REPEATS = 172_000, 128, 16, 1000, 31
#: Number of particles for the peer, which needs milliseconds for each.
PEERS_PARTICLES = 20
HEADINGS = 12
KERNEL = PoseKernel("rbf", (5.0, 5.0), 0.7, signal_variance=1 / DIMENSION, noise_variance=0.3 / DIMENSION)
LIKELIHOOD = Likelihood(tempering=0.25)


def run(count: int = COUNT, repeats: int = REPEATS) -> list[Row]:
    known = city(count)
    began = time.perf_counter()
    cached = CachedLocalGP(NEIGHBOURS).fit(known, KERNEL)
    built = time.perf_counter() - began
    naive = LocalGP(NEIGHBOURS, "nearest_image").fit(known, KERNEL)
    poses = around(known, PARTICLES)
    image = torch.from_numpy(traverse(1, seed=1))
    many, together = around(known, 10 * PARTICLES), around(known, PARTICLES, places=1)
    few = poses[:, :PEERS_PARTICLES]
    evidence = cached.observe(image, LIKELIHOOD)
    theirs = peer(known, naive, image[0], few[0])
    difference = np.abs(evidence.log_likelihood(few)[0].numpy() - theirs()).max() / DIMENSION

    rows, query = known.descriptors.numpy(), image[0].numpy()
    tensor = known.descriptors
    means = CachedLocalGP(NEIGHBOURS, map_evidence="mean").load_state(known, KERNEL, cached.state())
    seconds = medians(
        {
            "numpy product": lambda: rows @ query,
            "torch product": lambda: torch.mv(tensor, image[0]),
            "observe": lambda: cached.observe(image, LIKELIHOOD),
            "particles": lambda: evidence.log_likelihood(poses),
            "particles together": lambda: evidence.log_likelihood(together),
            "10 x particles": lambda: evidence.log_likelihood(many),
            "nearest images": lambda: cached.neighbourhoods.nearest(poses[0]),
            "over the map": evidence.over_map,
            "over the map, means": means.observe(image, LIKELIHOOD).over_map,
            "whole": lambda: whole(cached, image, poses),
            "naive": lambda: naive.observe(image, LIKELIHOOD).log_likelihood(poses),
        },
        repeats,
    )
    peers = medians({"peer": theirs}, 5)["peer"] / PEERS_PARTICLES
    each = seconds["particles"] / PARTICLES
    fastest = min(("numpy product", "torch product"), key=seconds.__getitem__)
    product = seconds[fastest]
    what = f"{PARTICLES:,} particles, {count:,} x {DIMENSION}, k={NEIGHBOURS}"
    return [
        ("caches built", f"{built:.1f} s", f"{count:,} images", f"{1e6 * built / count:.0f} us each", ""),
        ("agrees with scikit-learn", f"{difference:.1e} nats a dimension", "", "", "<= 1e-3"),
        _row("one particle", each, "scikit-learn", peers, ">= 1,000 x", faster=True),
        _row(
            "one of many at one place",
            seconds["particles together"] / PARTICLES,
            "scikit-learn",
            peers,
            "",
            faster=True,
        ),
        _row("one particle", each, "batched solve", seconds["naive"] / PARTICLES, "", faster=True),
        _row(f"observation: {what}", seconds["observe"], fastest, product, ""),
        _row("its particles", seconds["particles"], fastest, product, ""),
        _row("its particles at one place", seconds["particles together"], fastest, product, ""),
        _row("of its particles the nearest images", seconds["nearest images"], fastest, product, ""),
        _row("over the map, images", seconds["over the map"], fastest, product, ""),
        _row("over the map, means", seconds["over the map, means"], fastest, product, ""),
        _row("all of it", seconds["whole"], fastest, product, "<= 3"),
        _row("10 x the particles", seconds["10 x particles"], "1 x", seconds["particles"], "<= 10"),
    ]


def whole(model: CachedLocalGP, image: torch.Tensor, poses: torch.Tensor) -> None:
    """The evaluations of one step of a filter with restarts."""
    evidence = model.observe(image, LIKELIHOOD)
    evidence.log_likelihood(poses)
    evidence.over_map()


def city(count: int) -> DescriptorMap:
    """Panoramas 10 m apart along parallel streets, cut into images, with descriptors of norm one."""
    places = -(-count // HEADINGS)
    along, street = np.divmod(np.arange(places), 40)
    noise = np.random.default_rng(0).normal(0, 1, (places, 2))
    ground = np.stack([10.0 * along, 70.0 * street], axis=1) + noise
    heading = 2 * np.pi / HEADINGS * np.arange(HEADINGS) - np.pi
    poses = np.concatenate([ground.repeat(HEADINGS, axis=0), np.tile(heading, places)[:, None]], axis=1)[:count]
    return DescriptorMap.of(torch.from_numpy(poses), torch.from_numpy(traverse(count, DIMENSION)))


def around(known: DescriptorMap, particles: int, places: int | None = None) -> torch.Tensor:
    """Particles anywhere in the map, as after a global start, with the least cache locality; or around a few places."""
    random = np.random.default_rng(2)
    near = known.poses[random.integers(0, len(known), places or particles)].expand(particles, 3).numpy()
    return torch.from_numpy(near + random.normal(0, 1, near.shape) * (2.0, 2.0, 0.3))[None]


def peer(known: DescriptorMap, naive: LocalGP, image: torch.Tensor, poses: torch.Tensor) -> Callable[[], np.ndarray]:
    """A GaussianProcessRegressor of scikit-learn for each particle, on the same neighbours and hyper-parameters."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel

    features = KERNEL.features(known.poses).numpy()
    covariance = ConstantKernel(KERNEL.signal_variance) * RBF(1.0)
    asked, mean = KERNEL.features(poses).numpy(), known.mean.numpy()

    def log_likelihoods() -> np.ndarray:
        values = []
        for row, pose in enumerate(asked):
            near = naive.neighbourhoods.of_images(
                naive.neighbourhoods.nearest(poses[row : row + 1]), NEIGHBOURS
            ).rows.numpy()[0]
            model = GaussianProcessRegressor(covariance, alpha=KERNEL.noise_variance, optimizer=None)
            model.fit(features[near], known.descriptors.numpy()[near] - mean)
            centre, deviation = model.predict(pose[None], return_std=True)
            squared = float(np.square(image.numpy() - mean - centre[0]).sum())
            variance = float(np.ravel(deviation)[0]) ** 2 + KERNEL.noise_variance
            both = (torch.tensor(value, dtype=torch.float64) for value in (squared, variance))
            values.append(LIKELIHOOD.log_prob(*both, DIMENSION).item())
        return np.array(values)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        log_likelihoods()
    return log_likelihoods


def _row(what: str, ours: float, against: str, other: float, aim: str, *, faster: bool = False) -> Row:
    ratio = f"{other / ours:,.0f} x faster" if faster else f"{ours / other:.2f}"
    return what, _told(ours), f"{against} {_told(other)}", ratio, aim


def _told(seconds: float) -> str:
    return f"{1e3 * seconds:.2f} ms" if seconds > 1e-4 else f"{1e6 * seconds:.2f} us"
