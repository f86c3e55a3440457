"""Checks of what a localizer is given: its settings, parts, start and motion."""

import math
from collections.abc import Sequence
from numbers import Real
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float64
from numpy import ndarray
from torch import Tensor

from sextant.applications.arguments import check_kind, check_whole
from sextant.applications.pixels import detached
from sextant.data.positions import FURTHEST
from sextant.errors import UserError, shown
from sextant.localization.initialisation import AppearanceStart, Initialisation, UniformStart
from sextant.localization.likelihood import Likelihood
from sextant.localization.motion import MotionModel
from sextant.localization.observation import ObservationModel
from sextant.localization.pose_kernel import PoseKernel
from sextant.localization.recovery import Recovery

#: as in a config; more would take gigabytes, and seconds per step
MOST_PARTICLES = 1_000_000
STARTS: dict[str, type[Initialisation]] = {"uniform": UniformStart, "appearance": AppearanceStart}
#: the classes of a localizer's parts, each with an example
PARTS: dict[str, tuple[type, str]] = {
    "kernel": (PoseKernel, 'PoseKernel("rbf", (2.0, 2.0), 1.0, 0.01, 0.001) of sextant.localization.pose_kernel'),
    "observation": (ObservationModel, "LocalGP(16) of sextant.localization.observation.local_gp"),
    "likelihood": (Likelihood, "Likelihood(tempering=0.125) of sextant.localization.likelihood"),
    "motion": (MotionModel, "motion_of_spacing(2.0) of sextant.localization.motion"),
    "recovery": (Recovery, "NoRecovery() of sextant.localization.recovery"),
}
Start = Literal["uniform", "appearance"] | Initialisation


def as_motion(motion: Sequence[float] | ndarray | None) -> Float64[Tensor, "3"]:
    """A motion as numbers, three nan where it is unknown.

    Raises:
        UserError: it is not three finite numbers, is too far, or turns by more than a full turn.
    """
    if motion is None:
        return torch.full((3,), torch.nan, dtype=torch.float64)
    moved = torch.from_numpy(as_numbers(motion))
    if moved.shape != (3,) or not bool(moved.isfinite().all()):
        raise UserError(
            f"motion={shown(motion)} must be three finite numbers: dx, dy, dtheta",
            "Call step(motion, image), with None for the motion where odometry is missing.",
        )
    if bool((moved.abs() > FURTHEST).any()):
        raise UserError(
            f"motion={shown(motion)} is further than {FURTHEST:g}", "Give None where odometry is unreliable."
        )
    if abs(float(moved[2])) > 2 * math.pi:
        raise UserError(
            f"motion={shown(motion)} turns by {float(moved[2]):g} rad, more than a full turn, in one step",
            "dtheta is in rad: numpy.radians of degrees. Give None where odometry is unreliable.",
        )
    return moved


def as_numbers(given: Any) -> Float64[ndarray, "*n"]:
    """The values as an array; an array of a shape that matches nothing if they are not numbers."""
    try:
        return np.array(detached(given), np.float64)
    except (TypeError, ValueError, RuntimeError):
        return np.empty((0, 0))


def check_settings(radius: float, particles: int, start: Start, lag: int, region_scale: float = 1.0) -> None:
    """Check the settings of a localizer.

    Raises:
        UserError: one is of another kind or outside its range; the message names it.
    """
    check_whole("lag", lag, 0, "lag=20 keeps twenty steps")
    check_whole("particles", particles, 1, "For example particles=1000", MOST_PARTICLES)
    for name, value, fix in (
        ("radius", radius, "For example radius=2.5, in the map's unit"),
        ("region_scale", region_scale, "region_scale=1.0"),
    ):
        if isinstance(value, bool) or not isinstance(value, Real) or not 0 < value < math.inf:
            raise UserError(f"{name}={value!r} must be a number above 0 and finite", fix)
    check_start(start)


def start_of(start: Start) -> Initialisation:
    """The initialisation that a checked start names."""
    return start if isinstance(start, Initialisation) else STARTS[start]()


def check_start(start: Start) -> None:
    """Check that there is such a start.

    Raises:
        UserError: there is not.
    """
    if not isinstance(start, Initialisation) and not (isinstance(start, str) and start in STARTS):
        given = start if isinstance(start, str) else shown(start)
        raise UserError(f"start={given} must be one of {', '.join(STARTS)}", "start=uniform")


def check_parts(**given: Any) -> None:
    """Check the classes of parts, by the name of their argument; None is the default.

    Raises:
        UserError: a part is of another class.
    """
    for name, part in given.items():
        kind, fix = PARTS[name]
        check_kind(name, part, kind, f"For example {fix}; None uses the default.")
