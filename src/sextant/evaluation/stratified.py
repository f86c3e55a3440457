"""Unpaired difference of two groups of runs over several strata, such as networks."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy import stats

from sextant.evaluation.paired import spread_of


@dataclass(frozen=True)
class Sample:
    """Summary statistics of independent runs, sufficient for their mean and its error.

    Attributes:
        count: number of runs.
        mean: of their values; nan for none.
        spread: standard deviation; nan for fewer than two.

    Example:
        >>> Sample.of(np.array([1.0, 3.0, 5.0]))
        Sample(count=3, mean=3.0, spread=2.0)
    """

    count: int
    mean: float
    spread: float

    @classmethod
    def of(cls, values: Float[ndarray, "runs"]) -> "Sample":
        """The sample of one value per run."""
        numbers = np.asarray(values, float)
        mean = float(numbers.mean()) if len(numbers) else math.nan
        return cls(len(numbers), mean, spread_of(numbers))

    def joined(self, other: "Sample") -> "Sample":
        """The runs of both samples in one.

        >>> Sample.of(np.array([1.0, 3.0])).joined(Sample.of(np.array([2.0, 6.0]))).mean
        3.0
        """
        present = [sample for sample in (self, other) if sample.count]
        count = self.count + other.count
        if len(present) < 2:
            return present[0] if present else self
        mean = (self.count * self.mean + other.count * other.mean) / count
        squares = sum((s.count - 1) * s.spread**2 if s.count > 1 else 0.0 for s in present)
        squares += sum(s.count * (s.mean - mean) ** 2 for s in present)
        return Sample(count, mean, math.sqrt(squares / (count - 1)))


@dataclass(frozen=True)
class StratifiedDifference:
    """Treatment minus control, averaged over strata; in the unit of the input.

    Attributes:
        mean: of the differences of the strata, with equal weights.
        low, high: its interval.
        freedom: Welch and Satterthwaite's degrees of freedom.
        p_value: of Welch's t test, two-sided.
    """

    mean: float
    low: float
    high: float
    freedom: float
    p_value: float


def stratified_difference(
    strata: Sequence[tuple[Sample, Sample]], confidence: float = 0.95, largest: float = math.inf
) -> StratifiedDifference | None:
    """Compare two groups within each stratum, and combine the strata; with one stratum this is Welch's t test.

    With m, s and n of the runs of stratum k of K,

        D = (1/K) Σ_k (m_tk - m_ck),    V = Σ_k (v_tk + v_ck),    v = s² / (K² n),
        D ± t_ν sqrt(V),    ν = V² / Σ v² / (n - 1).

    Every stratum has its own variance but the same weight, even if its runs happen to agree.

    Args:
        strata: treatment and control of each.
        confidence: coverage of the interval, in (0, 1).
        largest: largest possible size of a difference in either direction; the interval is truncated there, which
            excludes no possible value.

    Returns:
        The difference; None if a group of a stratum has fewer than two runs, or there is no stratum.

    Source: Welch, Biometrika 34, 1947; Satterthwaite, Biometrics Bulletin 2, 1946.

    >>> found = stratified_difference([(Sample(10, 80.5, 7.2), Sample(19, 75.8, 8.0))])
    >>> f"{found.mean:+.1f} [{found.low:+.1f}, {found.high:+.1f}]"
    '+4.7 [-1.4, +10.8]'
    """
    groups = [sample for pair in strata for sample in pair]
    if not groups or min(sample.count for sample in groups) < 2:
        return None
    mean = sum(treatment.mean - control.mean for treatment, control in strata) / len(strata)
    parts = [sample.spread**2 / sample.count / len(strata) ** 2 for sample in groups]
    error = math.sqrt(sum(parts))
    if error == 0:
        return StratifiedDifference(mean, mean, mean, math.inf, 0.0 if mean else 1.0)
    freedom = error**4 / sum(part**2 / (sample.count - 1) for part, sample in zip(parts, groups, strict=True))
    half = float(stats.t.ppf((1 + confidence) / 2, freedom)) * error
    p_value = float(2 * stats.t.sf(abs(mean) / error, freedom))
    low, high = max(mean - half, -largest), min(mean + half, largest)
    return StratifiedDifference(mean, low, high, freedom, p_value)
