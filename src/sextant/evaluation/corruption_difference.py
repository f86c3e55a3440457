"""Two arms of an experiment under many corruptions, paired over seeds: differences, wins, a test over corruptions."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from sextant.evaluation.paired import PairedDifference, holm, paired_difference


@dataclass(frozen=True)
class CorruptionDifferences:
    """Treatment minus control in error, by corruption, in the unit of the input; below zero is better.

    Attributes:
        mean: the difference of the means over the corruptions.
        by_corruption: in the order of the treatment's errors.
        wins, losses: numbers of corruptions on which the treatment's mean error is lower, or higher.
        certain_wins, certain_losses: numbers of those whose interval over seeds lies wholly below, or above, zero; not
            corrected for multiplicity.
        p_holm: p-value of each corruption's paired t test over seeds, Holm-corrected for their number.
        holm_wins, holm_losses: numbers of wins and losses whose corrected p-value is below 1 - confidence.
        p_value: Wilcoxon's signed-rank test over corruptions, two-sided. Corruptions of one family are correlated, so
            this overstates the evidence; quote the interval of ``mean`` over seeds instead.
    """

    mean: PairedDifference
    by_corruption: Mapping[str, PairedDifference]
    wins: int
    losses: int
    certain_wins: int
    certain_losses: int
    p_holm: Mapping[str, float]
    holm_wins: int
    holm_losses: int
    p_value: float


def corruption_differences(
    treatment: Mapping[str, Float[ndarray, "seeds"]],
    control: Mapping[str, Float[ndarray, "seeds"]],
    *,
    confidence: float = 0.95,
) -> CorruptionDifferences:
    """Compare the errors of two arms, each with one number per seed and corruption.

    With a single seed there are wins, but no intervals: they are nan.

    Args:
        treatment, control: errors by corruption, both in the same unit, such as per cent; seeds in the same order.
        confidence: coverage of the intervals, in (0, 1).

    Raises:
        ValueError: the arms differ in corruptions or in number of seeds, or have none.

    >>> control = {"fog": np.array([12.0, 13.0, 14.0]), "snow": np.array([20.0, 20.0, 21.5])}  # three seeds each
    >>> treatment = {"fog": np.array([10.0, 12.0, 11.0]), "snow": np.array([20.0, 21.0, 22.0])}
    >>> found = corruption_differences(treatment, control)
    >>> found.mean.mean, found.wins, found.losses, found.certain_wins  # -2 in fog, +0.5 in snow
    (-0.75, 1, 1, 0)
    """
    if not treatment or set(treatment) != set(control):
        odd = sorted(set(treatment) ^ set(control))
        raise ValueError(f"both arms need the same corruptions, at least one; only one arm has {', '.join(odd)}")
    pairs = {name: (np.asarray(errors, float), np.asarray(control[name], float)) for name, errors in treatment.items()}
    by_corruption = {
        name: paired_difference(*pair, confidence=confidence, better="lower") for name, pair in pairs.items()
    }
    if len({difference.seeds for difference in by_corruption.values()}) > 1:
        raise ValueError("all corruptions need the same number of seeds")
    own, other = (np.mean([pair[arm] for pair in pairs.values()], axis=0) for arm in (0, 1))
    p_holm = dict(zip(by_corruption, holm([d.t_p_value for d in by_corruption.values()]), strict=True))
    kept = [d for name, d in by_corruption.items() if p_holm[name] < 1 - confidence]
    means = np.array([difference.mean for difference in by_corruption.values()])
    return CorruptionDifferences(
        mean=paired_difference(own, other, confidence=confidence, better="lower"),
        by_corruption=by_corruption,
        wins=int((means < 0).sum()),
        losses=int((means > 0).sum()),
        certain_wins=sum(difference.high < 0 for difference in by_corruption.values()),
        certain_losses=sum(difference.low > 0 for difference in by_corruption.values()),
        p_holm=p_holm,
        holm_wins=sum(difference.mean < 0 for difference in kept),
        holm_losses=sum(difference.mean > 0 for difference in kept),
        p_value=paired_difference(means, np.zeros_like(means)).p_value,
    )
