"""The default kernel and filter of a map, and a filter's settings as plain values; of Sextant's classes alone."""

import math
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from types import ModuleType
from typing import Any

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.errors import UserError
from sextant.localization import motion, recovery, resampling
from sextant.localization.constants import PLACE, WINDOW
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.kld_size import KLDSize
from sextant.localization.map_prior import MapPrior
from sextant.localization.map_support import MapSupport, map_spacing
from sextant.localization.motion import MotionModel, motion_of_spacing
from sextant.localization.particle_filter import ParticleFilter
from sextant.localization.pose_kernel import PoseKernel
from sextant.localization.recovery import BayesRestart, Recovery
from sextant.localization.resampling import SystematicResampling

#: the kernel is fitted to at most this many images of a map, evenly spaced
FITTED_TO = 600
LEARNING_RATE = 0.05
PACKAGES: dict[str, ModuleType] = {"motion": motion, "recovery": recovery, "resampling": resampling}


def filter_values(filter: ParticleFilter) -> dict[str, Any]:
    """The settings of a filter except the poses of its prior. A user-defined part becomes None."""
    values: dict[str, Any] = {name: _part(getattr(filter, name), package) for name, package in PACKAGES.items()}
    kld = None if filter.kld is None else asdict(filter.kld)
    held = filter.support
    reach = None if held is None or held.reach == math.inf else held.reach  # JSON has no infinity
    support = None if held is None else [reach, held.heading_reach, held.leave, held.outliers]
    apart = None if filter.apart is None else list(filter.apart)
    values |= {"ess_threshold": filter.ess_threshold, "kld": kld, "support": support, "apart": apart}
    return values | {"spread": list(filter.prior.sigmas)}


def filter_of(
    values: Mapping[str, Any], poses: Any, *, motion: MotionModel | None = None, recovery: Recovery | None = None
) -> ParticleFilter:
    """Build a filter from its values.

    Args:
        values: values from :func:`filter_values`.
        poses: poses of the map.
        motion, recovery: replace those of the values.

    Raises:
        UserError: a part was user-defined, and none is given in its place.
        KeyError, TypeError, ValueError: the values are damaged.
    """
    along, across, heading = (float(sigma) for sigma in values["spread"])
    support, apart = values.get("support"), values.get("apart")  # older maps have none
    if support is not None:
        support = [math.inf if value is None else float(value) for value in support]
    return ParticleFilter(
        motion or _made(values, "motion"),
        _made(values, "resampling"),
        recovery or _made(values, "recovery"),
        MapPrior(poses, (along, across), heading),
        ess_threshold=float(values["ess_threshold"]),
        kld=None if values["kld"] is None else KLDSize(**values["kld"]),
        support=None if support is None else MapSupport(poses, *support),
        apart=None if apart is None else (float(apart[0]), float(apart[1])),
    )


def fitted_kernel(found: DescriptorMap, steps: int = 60) -> PoseKernel:
    """Fit the kernel to the descriptors of a map by maximum likelihood, on at most 600 of its images.

    It may be called with gradients turned off.

    Args:
        found: the map.
        steps: gradient steps.

    Raises:
        UserError: the descriptors are all alike.
    """
    from sextant.localization.hyperparameters import TrainableKernel, joint_log_likelihood

    rows = torch.from_numpy(np.unique(np.linspace(0, len(found) - 1, min(FITTED_TO, len(found))).astype(np.int64)))
    with torch.inference_mode(False), torch.enable_grad():
        poses, descriptors = found.poses[rows], found.descriptors[rows]
        kernel = TrainableKernel.from_map(poses, descriptors)
        optimizer = torch.optim.Adam(kernel.parameters(), lr=LEARNING_RATE)
        for _ in range(steps):
            optimizer.zero_grad()
            loss = -joint_log_likelihood(kernel, poses, descriptors, found.mean) / descriptors.numel()
            loss.backward()
            optimizer.step()
        return kernel.frozen()


def usual_filter(
    poses: Float64[Tensor, "n 3"],
    kernel: PoseKernel,
    *,
    motion: MotionModel | None = None,
    recovery: Recovery | None = None,
) -> ParticleFilter:
    """The default filter for a map and its kernel; its scales follow from the map's spacing."""
    spacing, support = map_spacing(poses), MapSupport.of(poses, kernel)
    return ParticleFilter(
        motion or motion_of_spacing(spacing),
        SystematicResampling(),
        recovery or BayesRestart(window=WINDOW),
        MapPrior(poses, spacing / 2, support.heading_reach),
        support=support,
    )


#: the default number of particles, least and most. With 1,000 offices without odometry are found less often, and in a
#: city of 17,200 images 2,000 find fewer places than the nearest image (lab/localization.md)
LEAST_PARTICLES, MOST_USUAL = 2000, 10_000


def usual_particles(images: int) -> int:
    """The default number of particles: one for every two images of the map, within limits.

    >>> usual_particles(100), usual_particles(17_200), usual_particles(172_000)
    (2000, 8600, 10000)
    """
    return min(max(LEAST_PARTICLES, images // 2), MOST_USUAL)


def usual_radius(poses: Float64[Tensor, "n 3"]) -> float:
    """The default radius of a mode, in the unit of positions: 2.5 times the spacing of the map."""
    return PLACE * map_spacing(poses)


def _part(part: Any, package: ModuleType) -> dict[str, Any] | None:
    name = type(part).__name__
    if name not in package.__all__ or getattr(package, name) is not type(part):
        return None
    return {"class": name, "arguments": asdict(part) if is_dataclass(part) and not isinstance(part, type) else {}}


def _made(values: Mapping[str, Any], name: str) -> Any:
    node, package = values[name], PACKAGES[name]
    if node is None:
        raise UserError(
            f"the map was saved with a user-defined {name} model, which cannot be restored from its files",
            f"Give one: Localizer.load(folder, {name}=...)",
        )
    if node["class"] not in package.__all__:
        raise ValueError(f"unknown {name} class {node['class']!r}")
    arguments = {key: tuple(value) if isinstance(value, list) else value for key, value in node["arguments"].items()}
    return getattr(package, node["class"])(**arguments)
