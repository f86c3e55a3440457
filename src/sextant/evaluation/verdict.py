"""Whether a claim holds, fails or is undecided, from intervals and the smallest effect that matters."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from scipy import stats

from sextant.evaluation.protocols import SEEDS_FOR_A_CLAIM

Expectation = Literal["better", "as_good", "same"]
Verdict = Literal["holds", "fails", "undecided"]

#: probability of a wrong verdict on either side if the truth is exactly at the border
TAIL = 0.025
#: probability that the advised number of further seeds gives a verdict
POWER = 0.8
#: more seeds than this are not advised: the effect is practically at the border
MOST_SEEDS = 1000


@dataclass(frozen=True)
class Estimate:
    """An effect over seeds, positive where it favours the claim.

    Attributes:
        mean: of the effect.
        error: its standard error; nan for one seed, or if only the interval is known; 0 for a count.
        freedom: degrees of freedom of the error.
        seeds: number of seeds it is based on.
        known: a 95 % interval found other than by Student's t.
        floor: the noise floor: the difference that the choice of seeds alone makes.
        counted: whether it is exact, such as a number of parameters, and needs no seeds.

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

    @classmethod
    def of_pairs(cls, mean: float, spread: float, seeds: int, floor: float = 0.0) -> "Estimate":
        """The estimate from the mean and standard deviation of one value per seed, such as paired differences."""
        error = spread / math.sqrt(seeds) if seeds > 1 else math.nan
        return cls(mean, error, seeds - 1, seeds, floor=floor)

    def interval(self, tail: float = TAIL) -> tuple[float, float]:
        """The interval that leaves out this share on either side; nan without a known error."""
        if self.counted:
            return (self.mean, self.mean)
        if self.known is not None:  # only its width is known: scaled as Student's t would be
            wider = float(stats.t.ppf(1 - tail, self.seeds - 1) / stats.t.ppf(1 - TAIL, self.seeds - 1))
            low, high = self.known if tail == TAIL else (self.mean + wider * (end - self.mean) for end in self.known)
            return (low, high)
        half = float(stats.t.ppf(1 - tail, self.freedom)) * self.error if self.freedom > 0 else math.nan
        return (self.mean - half, self.mean + half)


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
    seeds decide nothing.

    Args:
        found: the effect, positive where it favours the claim.
        expects: what the claim says about it.
        matters: smallest effect that matters, in its unit, at least 0.
        parts: number of parts of the claim. All must hold, so holding needs no correction; one failure is enough, so
            failing is tested with Bonferroni's correction.

    >>> found = Estimate.of_pairs(mean=2.0, spread=1.0, seeds=9)  # from 1.23 to 2.77
    >>> [decide(found, "better", matters) for matters in (1.0, 2.0, 3.0)]
    ['holds', 'undecided', 'fails']
    """
    if not found.counted and found.seeds < SEEDS_FOR_A_CLAIM:
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

    >>> together(["holds", "undecided"]), together(["holds", "undecided", "fails"])
    ('undecided', 'fails')
    """
    if "fails" in verdicts:
        return "fails"
    return "holds" if verdicts and all(verdict == "holds" for verdict in verdicts) else "undecided"


def further_seeds(found: Estimate, expects: Expectation, matters: float, parts: int = 1) -> float | None:
    """Number of further seeds that an undecided comparison needs, if mean and spread stay as they are.

    The smallest n whose interval clears the border that the mean is beyond, with probability ``POWER``:
    ``(t_{1 - a} + t_{0.8}) s / sqrt(n) <= distance``, with a the tail of that verdict in :func:`decide`, and never
    fewer than ``SEEDS_FOR_A_CLAIM``.

    Args:
        found, expects, matters, parts: as for :func:`decide`.

    Returns:
        The number; infinite beyond ``MOST_SEEDS``, None if the spread of enough seeds is unknown.

    >>> found = Estimate.of_pairs(mean=2.0, spread=1.0, seeds=9)
    >>> further_seeds(found, "better", 1.5), further_seeds(found, "better", 2.0)  # a mean at the border stays undecided
    (25, inf)
    """
    if found.seeds < 2 or math.isnan(found.error):
        return max(0, SEEDS_FOR_A_CLAIM - found.seeds) or None
    bar, size = max(matters, abs(found.floor)), abs(found.mean)
    holds, fails = {
        "better": (found.mean - bar, matters - found.mean),
        "as_good": (found.mean + matters, -matters - found.mean),
        "same": (matters - size, size - bar),
    }[expects]
    spread = found.error * math.sqrt(found.seeds)
    for seeds in range(max(found.seeds, SEEDS_FOR_A_CLAIM), MOST_SEEDS + 1):
        freedom = found.freedom * seeds / found.seeds
        for distance, tail in ((holds, TAIL), (fails, TAIL / parts)):
            quantiles = stats.t.ppf(1 - tail, freedom) + stats.t.ppf(POWER, freedom)
            if distance > 0 and quantiles * spread / math.sqrt(seeds) <= distance:
                return seeds - found.seeds
    return math.inf
