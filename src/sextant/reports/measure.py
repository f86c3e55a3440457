"""What a report counts: how images become one number of a run, in which unit, and which way is better."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from jaxtyping import Float
from numpy import ndarray

from sextant.evaluation.calibration_summary import median_error

Images = Float[ndarray, "images"]


@dataclass(frozen=True)
class Measure:
    """How the test images of one run are summarised.

    Attributes:
        title: heading of the table of cells.
        difference: what a contrast is in.
        statistic: of the images of a run. Means of images can be compared image by image; medians only run by run.
        better: direction.
        diverged: when a run counts as diverged, for the reader.
        digits: behind the point.
    """

    title: str
    difference: str
    statistic: Literal["mean", "median"]
    better: Literal["higher", "lower"]
    diverged: str
    digits: int = 2

    def of(self, images: Images) -> float:
        """The number of a run; nan counts as an infinite error."""
        if self.statistic == "mean":
            return float(images.mean())
        return median_error(images)


ACCURACY = Measure(
    "Accuracy on the test split, per cent",
    "difference in accuracy (points)",
    "mean",
    "higher",
    "its validation accuracy after training is nearer to chance than to 1",
)
CALIBRATION = Measure(
    "Median errors on the test split",
    "difference in median error",
    "median",
    "lower",
    "its median bearing error on the validation split is above 0.8 of that of a constant camera",
    digits=3,
)
#: errors of the network that a run of calibration keeps, with their columns in a report
CALIBRATION_ERRORS = {
    "bearing_deg": "bearing (deg)",
    "tilt_deg": "tilt (deg)",
    "roll_deg": "roll (deg)",
    "vfov_deg": "vfov (deg)",
    "k1": "k1",
    "k1_hat": "k1_hat",
    "undistortion_px": "undistortion (px)",
}


def measured(arrays: Mapping[str, ndarray]) -> tuple[Measure, dict[str, Images]]:
    """The measure that belongs to the arrays of a run, and its values by image under each condition.

    Raises:
        KeyError: they are not the arrays of a run.
    """
    if "labels" in arrays:
        right = {key: 100.0 * (arrays[key] == arrays["labels"]) for key in arrays if key != "labels"}
        return ACCURACY, right
    return CALIBRATION, {title: arrays[f"{key}/network"] for key, title in CALIBRATION_ERRORS.items()}
