r"""Fusing one camera from several of its photos: focal length and apparent distortion, and whether they agree.

For estimates :math:`x_i` with standard errors :math:`\sigma_i` and weights :math:`w_i = 1/\sigma_i^2` the fused value
is :math:`\bar x = \sum w_i x_i / \sum w_i`. If all photos are from one camera and the errors are normal,
:math:`\chi^2 = \sum w_i (x_i - \bar x)^2` has n - 1 degrees of freedom for each quantity. If it is improbably large,
the one photo whose removal raises the p-value most is left out, provided that the rest then agree (with at least three
photos: of two, either may be wrong). If they still disagree, the standard error is widened by
:math:`\sqrt{\chi^2 / (n - 1)}`.

Errors of one network on photos of one lens are not independent. With a correlation c between any two,

.. math:: \operatorname{Var} \bar x = \frac{1 - c}{\sum w_i} + c \Big(\frac{\sum w_i \sigma_i}{\sum w_i}\Big)^2 ,

which does not vanish as n grows. The default, 1/4, is an assumption, not a measurement: with it, even many photos of
equal standard errors leave half the interval of one.

Source: R. T. Birge, "The calculation of errors by the method of least squares", Physical Review 40, 1932 (the ratio);
B. N. Taylor, "An introduction to error analysis", 1997, chapters 7 and 12.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy.special import chdtrc

CORRELATION = 0.25
LEVEL = 0.01  # of the consistency test: one good set in a hundred is rejected


@dataclass(frozen=True)
class Prior:
    """A normal prior on one quantity, with this mean and standard deviation."""

    mean: float
    sigma: float


@dataclass(frozen=True)
class Fusion:
    """Estimates of the same quantities, fused.

    Attributes:
        values: the fused values, one per quantity.
        sigmas: their standard errors.
        chi_square: of the estimates kept, over all quantities.
        degrees: its degrees of freedom.
        p_value: of the consistency test; 1 with a single estimate.
        kept: which estimates were used.
        consistent: whether the estimates kept pass the test.
        prior_z: standard errors between the prior and the estimates; nan without a prior.
    """

    values: Float[ndarray, "k"]
    sigmas: Float[ndarray, "k"]
    chi_square: float
    degrees: int
    p_value: float
    kept: Bool[ndarray, "n"]
    consistent: bool
    prior_z: float = float("nan")


def fuse(
    values: Float[ndarray, "n k"],
    sigmas: Float[ndarray, "n k"],
    *,
    correlation: float = CORRELATION,
    level: float = LEVEL,
) -> Fusion:
    """Fuse n estimates of k quantities; see the module.

    Args:
        values: one row per photo.
        sigmas: their standard errors; infinite where a photo does not determine a quantity.
        correlation: between the errors of any two photos, in [0, 1].
        level: of the consistency test.

    Raises:
        ValueError: there is no estimate, one is not finite, a standard error is not above 0, or no photo determines a
            quantity.

    >>> found = fuse(np.array([[1.0], [1.1], [3.0]]), np.full((3, 1), 0.1))  # the third photo is not of this camera
    >>> found.values, found.kept
    (array([1.05]), array([ True,  True, False]))
    """
    values, sigmas = np.asarray(values, float), np.asarray(sigmas, float)
    if values.ndim != 2 or values.size == 0 or values.shape != sigmas.shape:
        raise ValueError(f"need values and standard errors (n, k), got {values.shape} and {sigmas.shape}")
    if not (np.isfinite(values).all() and (sigmas > 0).all() and np.isfinite(sigmas).any(0).all()):
        raise ValueError("estimates must be finite, with standard errors above 0, one of each quantity finite")
    kept = np.ones(len(values), bool)
    chi_square, degrees = _chi_square(values, sigmas)
    p_value = _p_value(chi_square, degrees)
    if p_value < level and len(values) >= 3:
        without = {i: _without(values, sigmas, i) for i in range(len(values)) if _says_all(np.delete(sigmas, i, 0))}
        best = max(without, key=lambda i: without[i][2], default=None)
        if best is not None and without[best][2] >= level:
            kept[best] = False
            chi_square, degrees, p_value = without[best]
    mean, error = _weighted(values[kept], sigmas[kept], correlation)
    consistent = p_value >= level
    if not consistent:
        error = error * np.sqrt(max(chi_square / degrees, 1.0))
    return Fusion(mean, error, chi_square, degrees, p_value, kept, consistent)


def with_prior(fusion: Fusion, quantity: int, prior: Prior) -> Fusion:
    """Combine one of the fused quantities with a prior: the product of two normal densities.

    >>> found = with_prior(fuse(np.array([[1.0]]), np.array([[0.1]])), 0, Prior(mean=1.2, sigma=0.1))
    >>> found.values, found.sigmas.round(3), round(found.prior_z, 2)  # half-way, 0.1 / sqrt(2), and 0.2 / (0.1 sqrt(2))
    (array([1.1]), array([0.071]), 1.41)
    """
    value, sigma = fusion.values[quantity], fusion.sigmas[quantity]
    weight = 1 / sigma**2, 1 / prior.sigma**2
    values, sigmas = fusion.values.copy(), fusion.sigmas.copy()
    values[quantity] = (weight[0] * value + weight[1] * prior.mean) / sum(weight)
    sigmas[quantity] = sum(weight) ** -0.5
    z = float((prior.mean - value) / np.hypot(sigma, prior.sigma))
    return replace(fusion, values=values, sigmas=sigmas, prior_z=z)


def _weighted(
    values: Float[ndarray, "n k"], sigmas: Float[ndarray, "n k"], correlation: float
) -> tuple[Float[ndarray, "k"], Float[ndarray, "k"]]:
    weights = 1 / sigmas**2
    total = weights.sum(0)
    # w sigma = 1 / sigma, which is 0 and not nan where a photo does not determine the quantity
    variance = (1 - correlation) / total + correlation * ((1 / sigmas).sum(0) / total) ** 2
    return (weights * values).sum(0) / total, np.sqrt(variance)


def _chi_square(values: Float[ndarray, "n k"], sigmas: Float[ndarray, "n k"]) -> tuple[float, int]:
    mean, _ = _weighted(values, sigmas, 0.0)
    degrees = int(np.isfinite(sigmas).sum() - values.shape[1])
    return float((((values - mean) / sigmas) ** 2).sum()), degrees


def _p_value(chi_square: float, degrees: int) -> float:
    return float(chdtrc(degrees, chi_square)) if degrees > 0 else 1.0


def _without(values: Float[ndarray, "n k"], sigmas: Float[ndarray, "n k"], i: int) -> tuple[float, int, float]:
    chi_square, degrees = _chi_square(np.delete(values, i, 0), np.delete(sigmas, i, 0))
    return chi_square, degrees, _p_value(chi_square, degrees)


def _says_all(sigmas: Float[ndarray, "n k"]) -> bool:
    return bool(np.isfinite(sigmas).any(0).all())
