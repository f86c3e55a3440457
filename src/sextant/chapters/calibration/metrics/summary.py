r"""Summaries of a method's errors over a set of images: medians, means, and areas under the recall curve.

The area (``AUC@t``) is GeoCalib's. Recall, the share of errors up to e, is interpolated linearly from each sorted error
to the next and is constant from the last to t; errors up to m = 1 degree count as 0. The area is its integral over
[0, t], divided by t. For n images that is exactly

.. math:: \frac1n \sum_i g(e_i) + \frac{\max(0, e_{last} - m)}{2 n t}, \qquad
          g(e) = 1\ (e \le m),\quad 1 - e/t\ (m < e \le t),\quad 0\ (e > t),

with e_last the largest error up to t. In particular ``AUC@1`` is the share of errors up to 1 degree.

Intervals are from a percentile bootstrap over panoramas: crops of one panorama are not independent, so each resample
draws whole panoramas. With few panoramas (below some 20) the intervals cover less than their nominal level.

Sources: A. Veicht et al., "GeoCalib: learning single-image calibration with geometric optimization", ECCV 2024 (its
evaluation has ``min_error = 1``); P.-E. Sarlin et al., "SuperGlue", CVPR 2020, for the area under the exact curve.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int64, Integer
from numpy import ndarray

from sextant.evaluation.conformal import cluster_resamples
from sextant.evaluation.protocols import CALIBRATION_FAILURE_DEG
from sextant.evaluation.shares import median_error

FULL_BELOW = 1.0  # degrees: GeoCalib's ``min_error``
AUC_DEG = (1, 5, 10)
CONFIDENCE = 0.95  # of the intervals
#: prefix of the arrays of a run that mark the images of a kind of scene
KIND = "kind/"
AUC_OF = ("tilt_deg", "roll_deg", "vfov_deg", "bearing_deg")


@dataclass(frozen=True)
class Estimate:
    """A statistic with the ends of its interval; nan ends where there is only one panorama."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class ErrorSummary:
    """One error over a set of images.

    Attributes:
        images: number of images.
        panoramas: number of panoramas that they are from.
        answered: share of the images for which the method gave an answer.
        median: over all images; one without an answer counts as an infinite error.
        mean: over the answered images only; nan without any.
        auc: by threshold in degrees, in [0, 1], with unanswered images as infinite errors; empty for errors that are
            not angles.
    """

    images: int
    panoramas: int
    answered: float
    median: Estimate
    mean: Estimate
    auc: dict[int, Estimate]


def auc(errors: Float[ndarray, "n"], threshold: float, full_below: float = FULL_BELOW) -> float:
    """Area under the recall curve up to ``threshold``, in [0, 1]; nan counts as infinite, no errors give nan.

    ``full_below = 0`` gives the area as defined by SuperGlue. See the module for the formula.

    Raises:
        ValueError: ``threshold`` is not positive or below ``full_below``.

    >>> errors = np.array([0.5, 3.0])
    >>> round(auc(errors, 5), 6), auc(errors, 1)  # (1 + 0.4) / 2 + 2 / 20, and one of two is up to 1
    (0.8, 0.5)
    """
    if not len(errors):
        return float("nan")
    scores, last = _auc_parts(_infinite(errors), threshold, full_below)
    return float(scores.mean() + last.max() / (2 * len(errors) * threshold))


def _infinite(errors: Float[ndarray, "n"]) -> Float[ndarray, "n"]:
    return np.where(np.isnan(errors), np.inf, np.asarray(errors, float))


def _auc_parts(
    errors: Float[ndarray, "n"], threshold: float, full_below: float
) -> tuple[Float[ndarray, "n"], Float[ndarray, "n"]]:
    """The score g of each error, and its length beyond ``full_below`` if it is up to the threshold, else 0."""
    if threshold <= 0 or threshold < full_below:
        raise ValueError(f"the threshold must be positive and at least {full_below}, got {threshold}")
    reached = errors <= threshold
    finite = np.where(reached, errors, threshold)
    scores = np.where(errors <= full_below, 1.0, np.where(reached, 1 - finite / threshold, 0.0))
    return scores, np.where(reached, np.maximum(finite - full_below, 0), 0.0)


def summary(
    errors: Mapping[str, Float[ndarray, "n"]],
    panoramas: Integer[ndarray, "n"],
    *,
    resamples: int = 1000,
    seed: int = 0,
) -> dict[str, ErrorSummary]:
    """Median, mean and areas under the recall curve of each error, with intervals.

    Args:
        errors: by name, absolute; nan where the method gave no answer.
        panoramas: which panorama each image was cut from.
        resamples: of the bootstrap.
        seed: of the bootstrap; the same panoramas give the same resamples for every method and error.

    Raises:
        ValueError: there are no images, or the length of an error differs from that of ``panoramas``.

    >>> errors = {"tilt_deg": np.array([0.5, 1.0, 4.0, np.nan])}
    >>> found = summary(errors, panoramas=np.array([0, 0, 1, 1]))["tilt_deg"]
    >>> found.answered, found.median.value, round(found.mean.value, 2)  # the median of 0.5, 1, 4 and inf
    (0.75, 2.5, 1.83)
    """
    if not len(panoramas) or any(len(values) != len(panoramas) for values in errors.values()):
        raise ValueError(f"need errors and a panorama for each image, got {len(panoramas)} panoramas")
    clusters = np.unique(panoramas, return_inverse=True)[1].astype(np.int64)
    counts = cluster_resamples(clusters, resamples, seed)
    return {
        name: _summary_of(values, clusters, counts, AUC_DEG if name in AUC_OF else ())
        for name, values in errors.items()
    }


def _summary_of(
    values: Float[ndarray, "n"],
    clusters: Int64[ndarray, "n"],
    counts: Int64[ndarray, "resamples k"],
    thresholds: tuple[int, ...],
) -> ErrorSummary:
    answered = ~np.isnan(values)
    errors = _infinite(values)
    k = counts.shape[1]
    drawn = counts @ np.bincount(clusters, minlength=k)

    def total(of: Float[ndarray, "n"]) -> Float[ndarray, "resamples"]:
        sums: ndarray = counts @ np.bincount(clusters, weights=of, minlength=k)
        return sums

    with np.errstate(invalid="ignore", divide="ignore"):
        means = total(np.where(answered, errors, 0)) / total(answered.astype(float))
    areas = {}
    for t in thresholds:
        scores, last = _auc_parts(errors, float(t), FULL_BELOW)
        longest = np.zeros(k)
        np.maximum.at(longest, clusters, last)
        resampled = total(scores) / drawn + np.where(counts > 0, longest, 0).max(1) / (2 * drawn * t)
        areas[t] = _estimate(auc(errors, float(t)), resampled, k)
    mean = float(errors[answered].mean()) if answered.any() else float("nan")
    return ErrorSummary(
        images=len(values),
        panoramas=k,
        answered=float(answered.mean()),
        median=_estimate(median_error(errors), _resampled_medians(errors, clusters, counts), k),
        mean=_estimate(mean, means, k),
        auc=areas,
    )


def failures(
    bearing_deg: Float[ndarray, "n"], kinds: Mapping[str, Bool[ndarray, "n"]]
) -> dict[str, Bool[ndarray, "_"]]:
    """Which images a method fails on: its bearing error is above ``CALIBRATION_FAILURE_DEG``, or nan: no answer.

    Args:
        bearing_deg: by image.
        kinds: which images are of a kind, by its name.

    Returns:
        Of all images, and of those of each kind that has some.

    >>> found = failures(np.array([9.9, 10.1, np.nan]), {"dark": np.array([True, False, True])})
    >>> {kind: failed.tolist() for kind, failed in found.items()}
    {'all': [False, True, True], 'dark': [False, True]}
    """
    failed = ~(np.asarray(bearing_deg) <= CALIBRATION_FAILURE_DEG)
    return {"all": failed} | {kind: failed[of] for kind, of in kinds.items() if of.any()}


def _resampled_medians(
    errors: Float[ndarray, "n"], clusters: Int64[ndarray, "n"], counts: Int64[ndarray, "resamples k"]
) -> Float[ndarray, "resamples"]:
    order = np.argsort(errors)
    ordered, owner = errors[order], clusters[order]
    medians = np.empty(len(counts))
    for row, count in enumerate(counts):  # one at a time: all weights at once would take resamples x images
        reached = np.cumsum(count[owner])
        middle = np.searchsorted(reached, [(reached[-1] + 1) // 2, reached[-1] // 2 + 1])
        medians[row] = ordered[middle].mean()
    return medians


def _estimate(value: float, resampled: Float[ndarray, "resamples"], clusters: int) -> Estimate:
    if clusters < 2 or np.isnan(resampled).any():
        return Estimate(value, float("nan"), float("nan"))
    # order statistics, as interpolating between infinite ones gives nan
    low, high = np.quantile(resampled, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], method="inverted_cdf")
    return Estimate(value, float(low), float(high))


#: columns of the methods table: title, error, digits
TABLE = (
    ("tilt (°)", "tilt_deg", 2),
    ("roll (°)", "roll_deg", 2),
    ("vfov (°)", "vfov_deg", 2),
    ("true vfov (°)", "true_vfov_deg", 2),
    ("focal (%)", "focal_percent", 1),
    ("k1", "k1", 3),
    ("k1/f²", "k1_hat", 3),
    ("bearing (°)", "bearing_deg", 2),
    ("undistortion (px @480)", "undistortion_px", 1),
)


def methods_table(methods: Mapping[str, Mapping[str, ErrorSummary]]) -> tuple[list[str], list[list[str]]]:
    """Titles and rows of text, one row per method.

    Columns: the share of images for which the method gave an answer, median errors, and AUC@1/5/10 of the angles in
    percent.

    Args:
        methods: summaries of each method, in the order of the rows; a missing error is shown as a dash.

    >>> titles, rows = methods_table({"ours": summary({"tilt_deg": np.array([0.5, 1.5])}, np.array([0, 1]))})
    >>> titles[:3], rows[0][:3]
    (['method', 'answered (%)', 'tilt (°)'], ['ours', '100', '1.00'])
    """
    titles = [title for title, _, _ in TABLE]
    areas = [f"{name.removesuffix('_deg')} AUC@{'/'.join(map(str, AUC_DEG))}" for name in AUC_OF]
    rows = []
    for method, errors in methods.items():
        # share of complete cameras, or of the quantities that a method without complete cameras estimates
        whole = errors["bearing_deg"].answered if "bearing_deg" in errors else 0.0
        share = whole or max((of.answered for of in errors.values()), default=float("nan"))
        medians = [_cell(errors.get(name), digits) for _, name, digits in TABLE]
        rows.append([method, _number(100 * share, 0), *medians, *(_areas(errors.get(name)) for name in AUC_OF)])
    return ["method", "answered (%)", *titles, *areas], rows


def _cell(of: ErrorSummary | None, digits: int) -> str:
    return "–" if of is None else _number(of.median.value, digits)


def _areas(of: ErrorSummary | None) -> str:
    return "–" if of is None or of.answered == 0 else " / ".join(_number(100 * of.auc[t].value, 1) for t in AUC_DEG)


def _number(value: float, digits: int) -> str:
    """A dash for nan, and for the infinite median of a method that mostly gives no answer."""
    return f"{value:.{digits}f}" if np.isfinite(value) else "–"
