"""The measure of a run of recognition by filters in reports: accuracy of its methods."""

from collections.abc import Mapping

import numpy as np
from numpy import ndarray

from sextant.kit.measure import ANSWERS, CORRUPTED, UNDER, Measure, RunValues, accuracy_metrics, over_corruptions

RECOGNITION = Measure(
    "Accuracy on the test split, per cent",
    "accuracy",
    "difference in accuracy (points)",
    "mean",
    "higher",
    "the validation accuracy of its network after training is nearer to chance than to 1",
)


def recognised(arrays: Mapping[str, ndarray], reads: str | None = None) -> RunValues:
    """Accuracy of each method, or of the method ``reads`` under each condition of the test."""
    answers = {key.removeprefix(ANSWERS): arrays[key] for key in arrays if key.startswith(ANSWERS)}
    right = {method: 100.0 * (found == arrays["labels"]) for method, found in answers.items()}
    rights = {key: 100.0 * (arrays[key] == arrays["labels"]) for key in arrays if key.startswith(f"{CORRUPTED}/")}
    corrupted = {method: over_corruptions(rights, method) for method in right}
    values = right | {f"{method}, {CORRUPTED}": images for method, images in corrupted.items() if images is not None}
    if reads is not None:
        under = {key.removeprefix(UNDER): arrays[key] for key in arrays if key.startswith(UNDER)}
        values = {name: right[reads][rows] for name, rows in under.items()} or {"test": right[reads]}
        if (images := corrupted.get(reads)) is not None:
            each = under or {"test": np.ones(len(images), bool)}
            values |= {f"{name}, {CORRUPTED}": images[rows] for name, rows in each.items()}
    return RunValues(RECOGNITION, values, metrics=accuracy_metrics(right))
