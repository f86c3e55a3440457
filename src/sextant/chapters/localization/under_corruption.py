"""Localization by image corruption: success, tracking, errors, and how reliably the filter reports that it is lost.

The figures of a corruption are pooled over its severities, the drives, faults and numbers of particles. The filter
reports *lost* where its heaviest mode holds less than ``MODE_MASS`` of the weight; it is *astray* where its estimate
is outside the limits of the protocol.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

from sextant.chapters.localization.judged import Judged
from sextant.evaluation.headline import CLEAN
from sextant.evaluation.protocols import MODE_MASS
from sextant.evaluation.success import NEVER
from sextant.tables import number

#: columns of the table, with the figure and its factor
COLUMNS = {
    "found %": ("success", 100.0),
    "frames": ("frames_to_converge_median", 1.0),
    "tracking %": ("tracking", 100.0),
    "error": ("position_error_median", 1.0),
    "NLL": ("pose_nll", 1.0),
    "lost %": ("lost", 100.0),
    "of these astray %": ("lost_astray", 100.0),
    "astray called lost %": ("astray_lost", 100.0),
}


def by_corruption(found: Mapping[str, Judged]) -> dict[str, list[Judged]]:
    """The trials under each corruption, at any severity; ``clean`` first. Empty if no image was corrupted."""
    groups: dict[str, list[Judged]] = {}
    for judged in found.values():
        key = judged.outcome.trial.corruption
        groups.setdefault(key.rpartition("/")[0] if key else CLEAN, []).append(judged)
    return groups if len(groups) > 1 else {}


def success_by_condition(found: Mapping[str, Judged]) -> dict[str, float]:
    """Mean success of the trials by condition key: ``clean``, and ``corruption/severity``."""
    each: dict[str, list[float]] = {}
    for judged in found.values():
        each.setdefault(judged.outcome.trial.corruption or CLEAN, []).append(float(judged.found.mean()))
    return {key: float(np.mean(values)) for key, values in each.items()}


def pooled(trials: Sequence[Judged]) -> dict[str, float]:
    """Figures pooled over trials; nan where they are undefined, such as the error of runs that never converged.

    Returns:
        ``success``, ``tracking`` and ``frames_to_converge_median`` over all runs; ``position_error_median``,
        ``heading_error_deg_median`` and ``pose_nll`` over all frames from convergence on; and over all frames the
        share reported as ``lost``, the share of these that are astray (``lost_astray``), and the share of astray frames
        that are reported as lost (``astray_lost``).
    """
    converged = np.concatenate([judged.converged for judged in trials])
    at = converged[converged != NEVER]
    tracking = [judged.summary.tracking for judged in trials if judged.summary.tracking == judged.summary.tracking]
    after = {
        "position_error_median": np.concatenate([judged.position[judged.after] for judged in trials]),
        "heading_error_deg_median": np.concatenate([judged.heading_deg[judged.after] for judged in trials]),
    }
    nll = np.concatenate([judged.outcome.nll.T[judged.after] for judged in trials])
    lost, astray = (np.concatenate(parts) for parts in zip(*map(_frames, trials), strict=True))
    return {
        "success": float(np.mean([judged.found.mean() for judged in trials])),
        "tracking": float(np.mean(tracking)) if tracking else math.nan,
        "frames_to_converge_median": float(np.median(at)) if len(at) else math.nan,
        **{name: float(np.median(values)) if len(values) else math.nan for name, values in after.items()},
        "pose_nll": float(nll.mean()) if len(nll) else math.nan,
        "lost": float(lost.mean()),
        "lost_astray": float(astray[lost].mean()) if lost.any() else math.nan,
        "astray_lost": float(lost[astray].mean()) if astray.any() else math.nan,
    }


def metrics(found: Mapping[str, Judged]) -> dict[str, float]:
    """``test/under/<corruption>/<figure>`` of :func:`pooled`, ``clean`` included; nan values are left out."""
    return {
        f"test/under/{name}/{figure}": value
        for name, trials in by_corruption(found).items()
        for figure, value in pooled(trials).items()
        if value == value
    }


def table(found: Mapping[str, Judged]) -> list[dict[str, str]]:
    """A row for each corruption, clean images first."""
    rows = []
    for name, trials in by_corruption(found).items():
        figures = pooled(trials)
        row = {"images": name.replace("_", " "), "runs": str(sum(len(judged.found) for judged in trials))}
        for column, (figure, factor) in COLUMNS.items():
            row[column] = number(factor * figures[figure], 1 if factor == 100 else 2)
        rows.append(row)
    return rows


def _frames(judged: Judged) -> tuple[Bool[ndarray, "k"], Bool[ndarray, "k"]]:
    """Whether the frames of all runs are reported as lost, and whether they are astray."""
    there = judged.outcome.runs.inside.T
    return (judged.outcome.track.mass.T < MODE_MASS)[there], ~judged.inside[there]
