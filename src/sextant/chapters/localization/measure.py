"""The measure of a run of localization in reports: success along drives."""

from collections.abc import Mapping

import numpy as np
from numpy import ndarray

from sextant.kit.measure import CORRUPTED, Measure, RunValues, over_corruptions

SUCCESS = Measure(
    "Success, per cent of the runs along the test drives",
    "success",
    "difference in success (points)",
    "mean",
    "higher",
    "its posterior over the map's images is no likelier to be right on the validation drives than a uniform one",
    trained_by=(),
    remedy="Most often the descriptor cannot distinguish the places, or map and drives show different places.",
    digits=1,
    items="runs along drives",
    metrics=(
        *("success", "frames_to_converge_median", "recovered", "frames_to_recover_median", "tracking"),
        *("position_error_median", "heading_error_deg_median", "pose_nll", "nees_median", "coverage_95", "ess"),
        *("descriptor_nll", "us_per_particle", "ms_per_image", "ms_per_step_of_all_runs"),
        *("fit_map_s", "model_mb", "peak_memory_mb"),
    ),
)
#: prefix of the arrays of a localizer that mark the successful runs along the test drives
LOCALIZED = "success/"


def localized(arrays: Mapping[str, ndarray]) -> RunValues:
    """Success of localization: each "image" is one run along a test drive, and the conditions are the trials."""
    found = {key.removeprefix(LOCALIZED): 100.0 * arrays[key] for key in arrays if key.startswith(LOCALIZED)}
    success = {"test/success": float(np.mean([runs.mean() for runs in found.values()])) / 100} if found else {}
    shares = {key: 100.0 * arrays[key] for key in arrays if key.startswith(f"{CORRUPTED}/")}
    corrupted = {name: over_corruptions(shares, name) for name in found}
    under = {f"{name}, {CORRUPTED}": runs for name, runs in corrupted.items() if runs is not None}
    return RunValues(SUCCESS, found | under, metrics=success)
