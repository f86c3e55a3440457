"""Quality and cost of a sensor in its map, independent of any filter."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import median
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Float32, Float64
from torch import Tensor

from sextant.chapters.localization.data.drive import Drive
from sextant.evaluation.protocols import LocalizationProtocol
from sextant.geometry.planar import se2_compose
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation import ObservationModel
from sextant.localization.observers import Observer

#: number of poses that are weighted at a time
PARTICLES = 1000
#: number of timed repetitions, unless they take longer than ``PATIENCE_S`` together
REPEATS, PATIENCE_S = 7, 10.0
#: number of evenly spaced images of a drive whose density is evaluated
IMAGES = 400
T = TypeVar("T")


@dataclass(frozen=True)
class SensorCost:
    """The cost of a sensor, as medians on this machine with as many threads as torch uses.

    Attributes:
        us_per_particle: microseconds per pose, for weighting a thousand poses around the true one.
        ms_per_image: fixed cost of an image or scan in milliseconds, independent of the number of poses.
    """

    us_per_particle: float
    ms_per_image: float


def sensor_cost(observer: Observer, drive: Drive, protocol: LocalizationProtocol) -> SensorCost:
    """Time the work of a sensor in a step of a filter: process an image, and weight poses by it.

    Poses are drawn around the true one of the first frame with an observation, with the limits of the protocol as
    standard deviations. The first repetition is not counted, as it includes compilation and caching.

    Raises:
        ValueError: the drive has no observation.
    """
    seen = np.flatnonzero(drive.seen)
    if not len(seen):
        raise ValueError(f"the drive {drive.name} has no observation")
    poses = _about(torch.from_numpy(drive.poses[seen[0]]), protocol)
    observing, weighing = list[float](), list[float]()
    while len(weighing) <= REPEATS and (len(weighing) < 2 or sum(observing + weighing) < PATIENCE_S):
        evidence, seconds = timed(lambda: observer.observe(seen[:1]))
        observing.append(seconds)
        weighing.append(timed(lambda e=evidence: e.log_likelihood(poses[None]))[1])  # type: ignore[misc]
    return SensorCost(1e6 * median(weighing[1:]) / PARTICLES, 1e3 * median(observing[1:]))


def descriptor_nll(
    model: ObservationModel,
    likelihood: Likelihood,
    descriptors: Float32[Tensor, "n d"],
    poses: Float64[Tensor, "n 3"],
) -> float:
    r"""Negative log-likelihood of images at their true poses, in nats per value of the descriptor.

    .. math:: -\frac 1{nD} \sum_i \log p(z_i \mid x_i)

    with the appearance noise of the likelihood and without its tempering. For a model that is not a Gaussian process,
    the density is that of its predicted mean and variance.

    Returns:
        The value above; nan for the univariate form, which is not a density of a descriptor.
    """
    if likelihood.form == "univariate":
        return math.nan
    found = model.residuals(descriptors, poses[:, None])
    told = replace(likelihood, tempering=1.0).log_prob(found.squared, found.variance, model.map.dimension)
    return -float(told.mean()) / model.map.dimension


def looked_at(drive: Drive) -> np.ndarray:
    """At most about ``IMAGES`` evenly spaced frames of a drive that have an observation."""
    seen = np.flatnonzero(drive.seen)
    return seen[:: max(1, -(-len(seen) // IMAGES))]


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """The result of ``work``, and the seconds it took."""
    began = time.perf_counter()
    done = work()
    return done, time.perf_counter() - began


def _about(pose: Float64[Tensor, "3"], protocol: LocalizationProtocol) -> Float64[Tensor, "p 3"]:
    across = 0.0 if protocol.unit == "frames" else protocol.position
    turn = 0.0 if protocol.heading_deg is None else math.radians(protocol.heading_deg)
    noise = torch.randn(PARTICLES, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    return se2_compose(pose.expand(PARTICLES, 3), noise * pose.new_tensor([protocol.position, across, turn]))
