"""The measures of a calibration run in reports: median errors of the network, or failures of a method."""

from collections.abc import Mapping

from numpy import ndarray

from sextant.chapters.calibration.metrics.summary import KIND, failures
from sextant.evaluation.shares import median_error
from sextant.kit.measure import BEARINGS, Measure, RunValues

CALIBRATION = Measure(
    "Median errors on the test split",
    "median error",
    "difference in median error",
    "median",
    "lower",
    "its median bearing error on the validation split is above 0.8 of that of a constant camera",
    unit="",
    digits=3,
)
FAILURES = Measure(
    "Failures on the test split, per cent: bearings off by more than 10°, or no answer",
    "failures",
    "difference in failures (points)",
    "mean",
    "lower",
    CALIBRATION.diverged,
)
#: errors of the network that a calibration run stores, with their columns in a report
CALIBRATION_ERRORS = {
    "bearing_deg": "bearing (deg)",
    "tilt_deg": "tilt (deg)",
    "roll_deg": "roll (deg)",
    "vfov_deg": "vfov (deg)",
    "k1": "k1",
    "k1_hat": "k1_hat",
    "undistortion_px": "undistortion (px)",
}


def calibrated(arrays: Mapping[str, ndarray], reads: str | None = None) -> RunValues:
    """Errors of the network, with each quantity as a condition; or failures of the method ``reads``, on all test images
    and on those of each kind of scene."""
    if reads is not None:
        kinds = {key.removeprefix(KIND): arrays[key] for key in arrays if key.startswith(KIND)}
        return RunValues(FAILURES, {kind: 100.0 * of for kind, of in failures(arrays[BEARINGS + reads], kinds).items()})
    found = {key: arrays[f"{key}/network"] for key in CALIBRATION_ERRORS}
    medians = {f"test/{key}/network": median_error(errors) for key, errors in found.items()}
    return RunValues(CALIBRATION, {CALIBRATION_ERRORS[key]: found[key] for key in found}, metrics=medians)
