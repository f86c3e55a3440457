"""Whether a claim holds, fails or is undecided, from intervals and the smallest effect that matters."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import optimize, stats

from sextant.evaluation.protocols import SEEDS_FOR_A_CLAIM, WORLDS_FOR_A_CLAIM

Expectation = Literal["better", "as_good", "same"]
Verdict = Literal["holds", "fails", "undecided", "not learnt"]
#: what is drawn anew in each replicate: only the runs, or the world that they are run in
Replicate = Literal["seeds", "worlds"]
LEAST = {"seeds": SEEDS_FOR_A_CLAIM, "worlds": WORLDS_FOR_A_CLAIM}

#: probability of a wrong verdict on either side if the truth is exactly at the border
TAIL = 0.025
#: probability that the advised number of further seeds gives a verdict
POWER = 0.8
#: larger numbers of seeds, or factors of test images, are not advised: the effect is practically at the border
MOST_SEEDS = 1000
#: quantiles of the spread over which the probability of clearing two borders is averaged
QUANTILES = 1000


@dataclass(frozen=True)
class Estimate:
    """An effect over seeds or worlds, positive where it favours the claim.

    Attributes:
        mean: of the effect.
        error: its standard error; nan for one seed, or if only the interval is known; 0 for a count.
        freedom: degrees of freedom of the error.
        seeds: number of seeds, or of worlds, it is based on.
        known: a 95 % interval found other than by Student's t.
        floor: the noise floor: the difference due to the choice of seeds alone.
        counted: whether it is exact, such as a number of parameters, and needs no seeds.
        images: the part of ``error`` due to the choice of test images, independent of the number of seeds; 0 if it is
            unknown, or included in the variation between worlds.
        replicate: what ``seeds`` counts.
        learnt: whether both arms are better than a constant; otherwise there is nothing to compare.
        cut_short: whether its runs were cut short to try a design; such runs decide nothing.
        run: whether there are runs to estimate it from; without them the other values are meaningless.
        most: the largest size that an effect can have, such as 100 points.

    Example:
        >>> low, high = Estimate.of_pairs(mean=2.0, spread=1.0, seeds=9).interval()
        >>> f"{low:.2f} to {high:.2f}"  # 2 ± 2.31 / sqrt(9)
        '1.23 to 2.77'
    """

    mean: float
    error: float
    freedom: float
    seeds: int
    known: tuple[float, float] | None = None
    floor: float = 0.0
    counted: bool = False
    images: float = 0.0
    replicate: Replicate = "seeds"
    learnt: bool = True
    cut_short: bool = False
    run: bool = True
    most: float = math.inf

    @classmethod
    def of_pairs(
        cls, mean: float, spread: float, seeds: int, floor: float = 0.0, image_half: float = math.nan
    ) -> "Estimate":
        """The estimate from the mean and standard deviation of one value per seed, such as paired differences.

        ``image_half`` is half the 95 % interval of :func:`~sextant.evaluation.paired.crossed_interval`, for which the
        test images are a sample too.
        """
        error = spread / math.sqrt(seeds) if seeds > 1 else math.nan
        if seeds < 2 or math.isnan(image_half):
            return cls(mean, error, seeds - 1, seeds, floor=floor)
        both = max(error, image_half / float(stats.t.ppf(1 - TAIL, seeds - 1)))
        return cls(mean, both, seeds - 1, seeds, floor=floor, images=math.sqrt(both**2 - error**2))

    def interval(self, tail: float = TAIL) -> tuple[float, float]:
        """The interval that leaves out this share on either side; nan without a known error.

        If all n replicates are alike, up to ``1 - tail^(1/n)`` of all others may differ, by as much as is possible.
        """
        if self.counted:
            return (self.mean, self.mean)
        if self.alike:
            others = 1 - tail ** (1 / self.seeds)
            return (self.mean - others * (self.most + self.mean), self.mean + others * (self.most - self.mean))
        if self.known is not None:  # only its width is known: scaled as Student's t would be
            wider = float(stats.t.ppf(1 - tail, self.seeds - 1) / stats.t.ppf(1 - TAIL, self.seeds - 1))
            low, high = self.known if tail == TAIL else (self.mean + wider * (end - self.mean) for end in self.known)
            return (low, high)
        half = float(stats.t.ppf(1 - tail, self.freedom)) * self.error if self.freedom > 0 else math.nan
        return (self.mean - half, self.mean + half)

    @property
    def alike(self) -> bool:
        """Whether all replicates show exactly the same, as at a ceiling, so that there is no spread to go by."""
        return not self.counted and (self.error == 0 or (self.known is not None and self.known[0] == self.known[1]))


def decide(found: Estimate, expects: Expectation, matters: float, parts: int = 1) -> Verdict:
    """Decide one comparison.

    With [l, u] the 95 % interval of the effect, m the smallest effect that matters and f the noise floor,

    ========= ============================ ================================
    expects   holds                        fails
    ========= ============================ ================================
    better    l > max(m, f)                u < m
    as_good   l > -m                       u < -m
    same      -m < l and u < m             l > max(m, f) or u < -max(m, f)
    ========= ============================ ================================

    and everything else is undecided: "no effect" is *shown*, by an interval within (-m, m), or not claimed at all. An
    effect exactly at a border is decided one way or the other at most 5 times in 100. Fewer than ``SEEDS_FOR_A_CLAIM``
    seeds, or ``WORLDS_FOR_A_CLAIM`` worlds, or runs that were cut short decide nothing. Arms that are no better than a
    constant are not compared: *not learnt*.

    Args:
        found: the effect, positive where it favours the claim.
        expects: the effect that the claim expects.
        matters: smallest effect that matters, in its unit, at least 0.
        parts: number of parts of the claim. All must hold, so holding needs no correction; one failure is enough, so
            failing is tested with Bonferroni's correction.

    >>> found = Estimate.of_pairs(mean=2.0, spread=1.0, seeds=9)  # from 1.23 to 2.77
    >>> [decide(found, "better", matters) for matters in (1.0, 2.0, 3.0)]
    ['holds', 'undecided', 'fails']
    """
    if not found.learnt:
        return "not learnt"
    if not found.counted and (found.cut_short or found.seeds < LEAST[found.replicate]):
        return "undecided"
    low, high = found.interval()
    failing_low, failing_high = found.interval(TAIL / parts)
    bar = max(matters, abs(found.floor))
    if found.counted:  # without an interval the border itself belongs to the claim
        effect = {"better": found.mean - matters, "as_good": found.mean + matters, "same": matters - abs(found.mean)}
        return "holds" if effect[expects] >= 0 else "fails"
    rules = {
        "better": (low > bar, failing_high < matters),
        "as_good": (low > -matters, failing_high < -matters),
        "same": (-matters < low and high < matters, failing_low > bar or failing_high < -bar),
    }
    holds, fails = rules[expects]
    return "holds" if holds else "fails" if fails else "undecided"


def together(verdicts: Sequence[Verdict]) -> Verdict:
    """The verdict on a claim with several parts: it holds if all do, and fails if one does.

    Otherwise it is *not learnt* if a part is, because further seeds would not decide that part.

    >>> together(["holds", "undecided"]), together(["holds", "undecided", "fails"])
    ('undecided', 'fails')
    """
    first: tuple[Verdict, ...] = ("fails", "not learnt")
    for verdict in first:
        if verdict in verdicts:
            return verdict
    return "holds" if verdicts and all(verdict == "holds" for verdict in verdicts) else "undecided"


def further_seeds(found: Estimate, expects: Expectation, matters: float, parts: int = 1) -> float | None:
    """Number of further seeds that an undecided comparison needs, if mean and spread stay as they are.

    For replicates that are all alike, the smallest number that decides if all others are alike too. Otherwise the
    smallest n whose interval clears the border that the mean is beyond, or both borders between which it lies, with
    probability ``POWER``: the probabilities ``P(T > d / e - t_{1 - a})`` of missing them sum up to at most 0.2, with T
    Student's, d the distance of a border, ``e = sqrt(s² / n + i²)``, a the tail of that verdict in :func:`decide`, i
    the part of the error due to the test images, and n at least the smallest number that decides.

    Args:
        found, expects, matters, parts: as for :func:`decide`.

    Returns:
        The number; infinite beyond ``MOST_SEEDS``, None if there are enough seeds but their spread is unknown.

    >>> found = Estimate.of_pairs(mean=2.0, spread=1.0, seeds=9)
    >>> further_seeds(found, "better", 1.5), further_seeds(found, "better", 2.0)  # a mean at the border stays undecided
    (25, inf)
    """
    least = LEAST[found.replicate]
    if found.alike and math.isfinite(found.most):
        asked = (expects, matters, parts)
        more = (n for n in range(MOST_SEEDS) if decide(replace(found, seeds=found.seeds + n), *asked) != "undecided")
        return next(more, math.inf)
    if found.seeds < 2 or math.isnan(found.error) or found.alike:
        return max(0, least - found.seeds) or None
    spread = _seed_error(found) * math.sqrt(found.seeds)
    for seeds in range(max(found.seeds, least), MOST_SEEDS + 1):
        error = math.hypot(spread / math.sqrt(seeds), found.images)
        if _decides(found, expects, matters, parts, error, found.freedom * seeds / found.seeds):
            return seeds - found.seeds
    return math.inf


def further_images(found: Estimate, expects: Expectation, matters: float, parts: int = 1) -> float:
    """How many times the test images an undecided comparison needs with its current seeds; infinite if none suffice.

    >>> found = Estimate.of_pairs(mean=2.0, spread=1.0, seeds=9, image_half=2.0)  # from 0 to 4, mostly by the images
    >>> further_seeds(found, "better", 0.5), further_images(found, "better", 0.5)
    (inf, 6)
    """
    if not found.images > 0:
        return math.inf
    for times in range(2, MOST_SEEDS + 1):
        error = math.hypot(_seed_error(found), found.images / math.sqrt(times))
        if _decides(found, expects, matters, parts, error, found.freedom):
            return times
    return math.inf


def _seed_error(found: Estimate) -> float:
    """The part of an estimate's error that shrinks with more seeds."""
    return math.sqrt(max(0.0, found.error**2 - found.images**2))


def _decides(found: Estimate, expects: Expectation, matters: float, parts: int, error: float, freedom: float) -> bool:
    """Whether an interval of this error decides as the mean does, with probability ``POWER``."""
    bar, size = max(matters, abs(found.floor)), abs(found.mean)
    holds, fails = {
        "better": ((found.mean - bar,), matters - found.mean),
        "as_good": ((found.mean + matters,), -matters - found.mean),
        "same": ((matters - size, matters + size), size - bar),
    }[expects]

    def missed(distance: float, tail: float) -> float:
        return float(stats.t.sf(distance / error - stats.t.ppf(1 - tail, freedom), freedom))

    return sum(missed(distance, TAIL) for distance in holds) <= 1 - POWER or missed(fails, TAIL / parts) <= 1 - POWER


def power(distance: float, spread: float, count: int, tail: float = TAIL) -> float:
    """Probability that the t interval over ``count`` replicates clears a border that lies ``distance`` away.

    ``P(T > t_{1 - a})`` with T noncentral t of ``count - 1`` degrees of freedom and noncentrality
    ``distance sqrt(count) / spread``; distance and spread in one unit.

    >>> f"{power(distance=1.0, spread=1.0, count=8):.2f}, {power(distance=0.0, spread=1.0, count=8):.3f} at the border"
    '0.68, 0.025 at the border'
    """
    if count < 2:
        return math.nan
    if spread == 0:
        return float(distance > 0)
    reach = float(stats.t.ppf(1 - tail, count - 1))
    return float(stats.nct.sf(reach, count - 1, distance * math.sqrt(count) / spread))


def equivalence_power(below: float, above: float, spread: float, count: int) -> float:
    """Probability that the t interval over ``count`` replicates clears a border on either side of it.

    With s² of χ² over its degrees of freedom, and d the distance to either border, the mean over quantiles of s of
    ``P(-d_below + t s / sqrt(n) < mean < d_above - t s / sqrt(n))``, the mean being normal.

    >>> f"{equivalence_power(1.0, 1.0, spread=1.0, count=16):.2f}"
    '0.92'
    """
    if count < 2:
        return math.nan
    if spread == 0:
        return float(min(below, above) > 0)
    quantiles = (np.arange(QUANTILES) + 0.5) / QUANTILES
    drawn = np.sqrt(stats.chi2.ppf(quantiles, count - 1) / (count - 1))
    half = float(stats.t.ppf(1 - TAIL, count - 1)) * drawn
    high, low = (math.sqrt(count) * distance / spread - half for distance in (above, below))
    return float(np.maximum(0.0, stats.norm.cdf(high) - stats.norm.cdf(-low)).mean())


def detectable(spread: float, count: int, chance: float = POWER) -> float:
    """The distance from a border that ``count`` replicates clear with this probability, in the unit of ``spread``.

    >>> f"{detectable(spread=1.0, count=8):.2f}, {detectable(spread=1.0, count=32):.2f}"
    '1.16, 0.51'
    """
    if count < 2 or spread == 0:
        return 0.0 if spread == 0 else math.inf
    return spread * float(optimize.brentq(lambda size: power(size, 1.0, count) - chance, 0.0, 1e3))
