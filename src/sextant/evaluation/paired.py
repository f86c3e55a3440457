"""Paired comparison of two arms of an experiment over seeds, with the images of each seed nested.

A *difference* here is treatment minus control at one seed. The seed is the unit of replication: runs with different
seeds are independent; the test images of one run are not.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy import stats

from sextant.ranges import checked

Better = Literal["higher", "lower"]
#: Number of stretches of neighbouring test images whose means count as the sample: neighbouring frames of a drive are
#: correlated, stretches less so. With as many stretches as a claim needs seeds, little is lost where images are
#: independent. Source of batch means: Schmeiser, Batch size effects in the analysis of simulation output, Oper. Res.
#: 30, 1982.
BLOCKS = 8
#: significant digits of a difference, relative to the largest value; the rest is rounding
DIGITS = 12


@dataclass(frozen=True)
class PairedDifference:
    """A mean difference over seeds, its interval and its tests; values in the unit of the input.

    Attributes:
        seeds: number of pairs.
        mean: of the differences.
        spread: their standard deviation: the scatter of a single pair of runs.
        low, high: the interval for the mean over seeds, on these test images.
        image_low, image_high: the interval when the test images count as a sample too, in ``BLOCKS`` stretches of
            neighbours: wider, or nan without images.
        p_value: of Wilcoxon's signed-rank test, two-sided; nan with fewer than two pairs.
        t_p_value: of the paired t test, two-sided, matching the t interval; nan with fewer than two pairs.
        wins: number of pairs in which the treatment is better.
    """

    seeds: int
    mean: float
    spread: float
    low: float
    high: float
    image_low: float
    image_high: float
    p_value: float
    t_p_value: float
    wins: int


@checked
def paired_difference(
    treatment: Float[ndarray, "seeds *images"],
    control: Float[ndarray, "seeds *images"],
    *,
    confidence: float = 0.95,
    better: Better = "higher",
    largest: float = math.inf,
) -> PairedDifference:
    """Compare two arms pair by pair.

    With ``D[s, i]`` the difference of seed ``s`` on image ``i`` and ``d_s`` its mean over images, the interval is
    ``mean(d) ± t_{S-1} · sd(d) / sqrt(S)``.

    Args:
        treatment, control: one row per pair, and one column per test image if there are any.
        confidence: coverage of the intervals, in (0, 1).
        better: whether higher or lower values are better.
        largest: largest possible size of a difference in either direction, such as 100 percentage points; intervals are
            truncated there, which excludes no possible value.

    Raises:
        ValueError: the shapes differ or there is no pair.
        ArgumentError: the direction is unknown.

    >>> found = paired_difference(np.array([81.0, 83.0, 80.0, 84.0]), np.array([80.0, 81.0, 80.5, 82.0]))
    >>> f"{found.mean:+.3f} [{found.low:+.2f}, {found.high:+.2f}], better in {found.wins} of {found.seeds}"
    '+1.125 [-0.75, +3.00], better in 3 of 4'
    """
    if treatment.shape != control.shape or len(treatment) == 0:
        raise ValueError(f"need the same pairs in both arms, at least one; got {treatment.shape} and {control.shape}")
    values = np.asarray([treatment, control], float)
    images = (values[0] - values[1]).reshape(len(treatment), -1)
    per_seed = images.mean(axis=1)
    scale = np.abs(values).max(where=np.isfinite(values), initial=0.0) or 1.0
    ranked = np.round(per_seed / scale, DIGITS)  # values equal up to rounding are ties
    if np.ptp(ranked) == 0:
        per_seed = np.full_like(per_seed, per_seed.mean() if ranked.any() else 0.0)
    low, high = _t_interval(per_seed, confidence)
    image_low, image_high = crossed_interval(images, confidence)
    return PairedDifference(
        seeds=len(per_seed),
        mean=float(per_seed.mean()),
        spread=spread_of(per_seed),
        low=max(low, -largest),  # of nan and a number, max and min return the first: nan
        high=min(high, largest),
        image_low=max(image_low, -largest),
        image_high=min(image_high, largest),
        p_value=_wilcoxon(ranked),
        t_p_value=_t_p_value(per_seed),
        wins=int(((ranked > 0) if better == "higher" else (ranked < 0)).sum()),
    )


def crossed_interval(images: Float[ndarray, "seeds images"], confidence: float = 0.95) -> tuple[float, float]:
    """t interval of the mean when seeds and images are both random and all seeds share the images.

    Images in the order of a drive are not an independent sample, so they count as ``min(BLOCKS, N)`` means over
    stretches of neighbours, each ``N / BLOCKS`` images long (batch means). Two-way random effects, with B the number of
    stretches: ``Var = s²(seed means)/S + V(B)``, ``V(B) = s²(stretch means)/B - MSE/(S B)``; min(S, B) - 1 degrees of
    freedom, which is conservative when images dominate. Neighbouring stretches are still correlated: V(B) is too small
    by a term proportional to B, which is half as large in V(B/2) and cancels in ``2 V(B/2) - V(B)``; the larger of V(B)
    and the latter is used. Under the null, with frames correlated over ten of 400, 3.8 % of the intervals exclude zero,
    and 4.8 % where only images vary (with V(B) alone, 5.6 and 7.0 %); with uncorrelated frames, 3.2 %. Fewer than two
    seeds or images give nan.

    Source: D. Vats, J. Flegal, "Lugsail lag windows for estimating time-average covariance matrices", Biometrika 109,
    2022.

    >>> values = np.array([[0.0, 4.0], [1.0, 5.0], [2.0, 6.0]])  # three seeds on the same two images
    >>> [f"{low:.1f} to {high:.1f}" for low, high in (mean_interval(values.mean(axis=1)), crossed_interval(values))]
    ['0.5 to 5.5', '-23.5 to 29.5']
    """
    seeds, count = len(images), min(BLOCKS, images.shape[1])
    if seeds < 2 or count < 2:
        return (float("nan"), float("nan"))
    image_part, mean = _of_stretches(images, count), images.mean()
    if count == BLOCKS:
        image_part = max(image_part, 2 * _of_stretches(images, BLOCKS // 2) - image_part)
    variance = images.mean(axis=1).var(ddof=1) / seeds + max(image_part, 0.0)
    half = stats.t.ppf((1 + confidence) / 2, min(seeds, count) - 1) * np.sqrt(variance)
    return (float(mean - half), float(mean + half))


def _of_stretches(images: Float[ndarray, "seeds images"], count: int) -> float:
    """The variance of the mean due to the choice of images, estimated from ``count`` stretches of them."""
    blocks = np.stack([part.mean(axis=1) for part in np.array_split(images, count, axis=1)], axis=1)
    residual = blocks - blocks.mean(axis=1)[:, None] - blocks.mean(axis=0) + blocks.mean()
    mse = (residual**2).sum() / ((len(images) - 1) * (count - 1))
    return float(blocks.mean(axis=0).var(ddof=1) / count - mse / (len(images) * count))


def mean_interval(values: Float[ndarray, "seeds"], confidence: float = 0.95) -> tuple[float, float]:
    """t interval ``mean ± t_{S-1} · sd / sqrt(S)`` of a mean over S seeds, in its unit; nan for fewer than two.

    >>> low, high = mean_interval(np.array([1.0, 2.0, 3.0]))
    >>> f"{low:.2f} to {high:.2f}"  # 2 ± 4.30 / sqrt(3), wide for three seeds
    '-0.48 to 4.48'
    """
    return _t_interval(np.asarray(values, float), confidence)


def spread_of(values: Float[ndarray, "n"]) -> float:
    """Standard deviation of values; exactly 0 if they are all alike up to rounding, nan for fewer than two.

    >>> spread_of(np.full(3, 0.1)), bool(np.full(3, 0.1).std(ddof=1) > 0)
    (0.0, True)
    """
    if len(values) < 2:
        return float("nan")
    return 0.0 if _all_equal(values) else float(values.std(ddof=1))


def _all_equal(values: Float[ndarray, "seeds"]) -> bool:
    """Whether all values are equal up to rounding."""
    return bool(np.ptp(values) <= 1e-12 * np.abs(values).max())


def _t_interval(values: Float[ndarray, "seeds"], confidence: float) -> tuple[float, float]:
    if len(values) < 2:
        return (float("nan"), float("nan"))
    if _all_equal(values):
        return (float(values.mean()), float(values.mean()))
    interval = stats.ttest_1samp(values, 0.0).confidence_interval(confidence)
    return (float(interval.low), float(interval.high))


def _t_p_value(values: Float[ndarray, "seeds"]) -> float:
    if len(values) < 2:
        return float("nan")
    if _all_equal(values):
        return 0.0 if np.any(values) else 1.0
    return float(stats.ttest_1samp(values, 0.0).pvalue)


def _wilcoxon(values: Float[ndarray, "seeds"]) -> float:
    if len(values) < 2:
        return float("nan")
    if not np.any(values):
        return 1.0
    return float(stats.wilcoxon(values).pvalue)


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's step-down adjusted p-values; nan entries stay nan and do not count as tests.

    Of n tests, the i-th smallest p is multiplied by n - i + 1, and adjusted values never decrease with p. SciPy has
    no such function, and that of statsmodels runs garbage collection on every call, which takes longer than all else.

    Source: S. Holm, A simple sequentially rejective multiple test procedure, Scand. J. Statistics 6, 1979.

    >>> holm([0.01, 0.04, 0.03])  # times 3, 1 and 2; the largest no less than the one before it
    [0.03, 0.06, 0.06]
    """
    values = np.asarray(p_values, float)
    tested = np.flatnonzero(~np.isnan(values))
    order = tested[np.argsort(values[tested])]
    adjusted = np.full_like(values, np.nan)
    scaled = values[order] * np.arange(len(order), 0, -1)
    adjusted[order] = np.minimum(np.maximum.accumulate(scaled), 1)
    return [float(p) for p in adjusted]
