r"""Whether a predicted uncertainty identifies the images with large errors.

Images are removed one by one, the most uncertain first; the *sparsification curve* is the mean error of the rest,
divided by the mean error of all. The *oracle* removes the largest error first, which is the lowest possible curve.
Random removal gives 1 on average. With A(.) the area between a curve and the oracle's, over the share removed,

.. math:: \mathrm{AUSE} = A(\text{uncertainty}), \qquad
          \mathrm{relative} = A(\text{uncertainty}) / A(\text{random}) ,

so that the relative area is 0 for an uncertainty that orders images as their errors do, 1 for an uninformative one and
more for a misleading one. Images of equal uncertainty count as removed in random order: a constant gives exactly 1.

Source: E. Ilg et al., "Uncertainty estimates and multi-hypotheses networks for optical flow", ECCV 2018.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy import stats


@dataclass(frozen=True)
class Sparsification:
    """Curves over the share of images removed, and their summaries; see the module.

    Attributes:
        removed: share removed, from 0 to 1 - 1/n.
        curve: mean error of the rest over that of all, by uncertainty.
        oracle: the same by the errors themselves.
        ause: area between the two.
        relative: ``ause`` over that of random order; nan if all errors are equal, as no order then matters.
        spearman: rank correlation of uncertainty and error; nan if either is constant.
    """

    removed: Float[ndarray, "n"]
    curve: Float[ndarray, "n"]
    oracle: Float[ndarray, "n"]
    ause: float
    relative: float
    spearman: float


def sparsification(errors: Float[ndarray, "n"], uncertainty: Float[ndarray, "n"]) -> Sparsification:
    """Measure how well ``uncertainty`` orders ``errors``.

    Args:
        errors: absolute, finite.
        uncertainty: uncertainty of each; only its order matters.

    Raises:
        ValueError: there are no errors, their mean is 0, a value is not finite or negative, or the lengths differ.

    >>> errors = np.array([1.0, 2.0, 3.0, 4.0])
    >>> [round(sparsification(errors, said).relative, 2) for said in (errors, np.ones(4), -errors)]  # worst: reversed
    [0.0, 1.0, 2.0]
    """
    errors, uncertainty = np.asarray(errors, float), np.asarray(uncertainty, float)
    if errors.shape != uncertainty.shape or not len(errors):
        raise ValueError(f"need an uncertainty for each error, got {uncertainty.shape} for {errors.shape}")
    if not (np.isfinite(errors).all() and np.isfinite(uncertainty).all() and (errors >= 0).all() and errors.any()):
        raise ValueError("errors and uncertainties must be finite, errors not negative and not all 0")
    count = len(errors)
    curve, oracle = _kept_means(errors, uncertainty) / errors.mean(), _kept_means(errors, errors) / errors.mean()
    area, of_random = float((curve - oracle).mean()), float((1 - oracle).mean())
    alike = np.ptp(errors) == 0
    constant = alike or np.ptp(uncertainty) == 0
    return Sparsification(
        removed=np.arange(count) / count,
        curve=curve,
        oracle=oracle,
        ause=area,
        relative=float("nan") if alike else area / of_random,
        spearman=float("nan") if constant else float(stats.spearmanr(errors, uncertainty).statistic),
    )


def _kept_means(errors: Float[ndarray, "n"], by: Float[ndarray, "n"]) -> Float[ndarray, "n"]:
    """Mean error of the rest when the 0, 1, ... n - 1 images with the largest ``by`` are removed."""
    _, tie, sizes = np.unique(by, return_inverse=True, return_counts=True)
    expected = (np.bincount(tie, weights=errors) / sizes)[tie]  # ties leave in random order
    kept = np.cumsum(expected[np.argsort(by)]) / np.arange(1, len(errors) + 1)
    return kept[::-1]
