"""One trial of a localization test, judged by the protocol of its dataset."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray

from sextant.chapters.localization.data.drive import LocalizationData
from sextant.chapters.localization.testing import Outcome
from sextant.chapters.localization.validation import protocol_of
from sextant.evaluation.pose_posterior import PLANE, RAILWAY, nees, pose_errors
from sextant.evaluation.protocols import RECOVERY_HORIZON
from sextant.evaluation.success import (
    NEVER,
    ConvergenceSummary,
    converged_at,
    global_localization,
    recovery_after,
    within,
)


@dataclass(frozen=True, eq=False)
class Judged:
    """One trial, judged by the protocol.

    Attributes:
        outcome: the trial.
        position, heading_deg: errors of each run, step by step; nan beyond a run's end.
        inside: whether both are within the protocol's limits.
        converged: the step at which each run converged, or ``NEVER``.
        frames: number of consecutive frames for which a run must be within the limits.
        summary: convergence from the start.
        recovery: convergence from the kidnap on, if runs were kidnapped.
        nees: NEES of the steps from convergence on; inf where all particles agree on a wrong value.
    """

    outcome: Outcome
    position: Float64[ndarray, "r t"]
    heading_deg: Float64[ndarray, "r t"]
    inside: Bool[ndarray, "r t"]
    converged: Int64[ndarray, "r"]
    frames: int
    summary: ConvergenceSummary
    recovery: ConvergenceSummary | None
    nees: Float64[ndarray, "k"]

    @property
    def found(self) -> Bool[ndarray, "r"]:
        """Whether each run converged: after the kidnap, if there was one."""
        kidnapped = self.outcome.runs.kidnapped_at
        if (kidnapped < 0).all():
            return np.asarray(self.converged != NEVER)
        again = converged_at(self.inside, self.frames, start=np.maximum(kidnapped, 0), horizon=RECOVERY_HORIZON)
        return np.asarray(again != NEVER)

    @property
    def after(self) -> Bool[ndarray, "r t"]:
        """Steps from convergence on."""
        at = np.arange(self.inside.shape[1])
        later = (at >= self.converged[:, None]) & (self.converged != NEVER)[:, None]
        return np.asarray(later & self.outcome.runs.inside.T)


def axes_of(data: LocalizationData) -> tuple[int, ...]:
    """The coordinates of a pose in which errors are measured."""
    return RAILWAY if protocol_of(data).unit == "frames" else PLANE


def judge(outcome: Outcome, data: LocalizationData) -> Judged:
    """Errors and success of the runs of a trial."""
    protocol, runs, track = protocol_of(data), outcome.runs, outcome.track
    errors = pose_errors(runs.poses, track.pose).transpose(1, 0, 2)
    gone = ~runs.inside.T
    position = np.where(gone, np.nan, np.linalg.norm(errors[..., :2], axis=2))
    heading = np.where(gone, np.nan, np.abs(np.degrees(errors[..., 2])))
    inside = within(position, heading, protocol)
    kidnapped = runs.kidnapped_at
    taken = bool((kidnapped >= 0).any())
    at = np.arange(inside.shape[1])
    before = inside & ((kidnapped < 0)[:, None] | (at < kidnapped[:, None]))  # a kidnapped run starts anew
    converged = converged_at(before, protocol.frames)
    values = nees(runs.poses, track.pose, track.covariance, axes_of(data)).T
    later = (at >= converged[:, None]) & (converged != NEVER)[:, None] & ~gone
    return Judged(
        outcome,
        position,
        heading,
        inside,
        converged,
        protocol.frames,
        global_localization(before, protocol, length=np.where(kidnapped >= 0, kidnapped, runs.lengths)),
        recovery_after(inside, np.maximum(kidnapped, 0), protocol, length=runs.lengths) if taken else None,
        values[later],
    )
