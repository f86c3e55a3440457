r"""Error of a classifier under corruption relative to that of a baseline.

With :math:`E_{c,s}` the error (share of wrong predictions) under corruption c at severity s, :math:`A_{c,s}` that of a
baseline, and :math:`E_0, A_0` both on clean images,

.. math:: CE_c = \frac{\sum_s E_{c,s}}{\sum_s A_{c,s}}, \qquad
          rCE_c = \frac{\sum_s (E_{c,s} - E_0)}{\sum_s (A_{c,s} - A_0)},

and mCE, mean rCE and E are means over the corruptions of a set. The relative error measures how much is *lost* to the
corruption: the clean *error* is subtracted, not the accuracy. All values are shares (1 is the baseline's error); papers
print them times 100. Three conventions are in use, whose figures are not comparable: E alone over 15 corruptions
(RobustBench, AugMix), CE over 15 (ImageNet-C), and CE over 19 (the push-pull paper).

Source: D. Hendrycks, T. Dietterich, "Benchmarking neural network robustness to common corruptions and perturbations",
ICLR 2019, section 4.1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sextant.evaluation.corruption_baseline import CorruptionBaseline
from sextant.evaluation.corruption_error import CorruptionErrors, present


@dataclass(frozen=True)
class CorruptionScore:
    """The scores of one model on a set of corruptions; ratios are shares, 1 being the baseline's error.

    Attributes:
        baseline: name of the baseline to which ``ce`` and ``relative_ce`` are ratios.
        clean: error on clean images.
        error: mean error over the corruptions.
        mean_ce, mean_relative_ce: mean of ``ce`` and of ``relative_ce``.
        ce, relative_ce: by corruption, in the order of the set.
    """

    baseline: str
    clean: float
    error: float
    mean_ce: float
    mean_relative_ce: float
    ce: Mapping[str, float]
    relative_ce: Mapping[str, float]


def corruption_ratio(errors: Sequence[float], baseline: Sequence[float]) -> float:
    """:math:`CE = \\sum_s E_s / \\sum_s A_s` of one corruption; a baseline's mean over severities stands for each.

    Raises:
        ValueError: the numbers of severities differ, there are none, or the baseline makes no error.

    >>> round(corruption_ratio([0.2, 0.4], [0.3, 0.5]), 2), round(corruption_ratio([0.2, 0.4], [0.4]), 2)
    (0.75, 0.75)
    """
    return relative_corruption_ratio(errors, 0.0, baseline, 0.0)


def relative_corruption_ratio(
    errors: Sequence[float], clean: float, baseline: Sequence[float], baseline_clean: float
) -> float:
    """:math:`rCE = \\sum_s (E_s - E_0) / \\sum_s (A_s - A_0)` of one corruption.

    It is undefined, and may change sign, if the corruption does not hurt the baseline.

    Raises:
        ValueError: the numbers of severities differ, there are none, or the baseline loses nothing.

    >>> round(relative_corruption_ratio([0.2, 0.4], 0.1, [0.3, 0.5], 0.1), 2)  # (0.1 + 0.3) / (0.2 + 0.4)
    0.67
    """
    if len(baseline) not in (1, len(errors)) or not errors:
        raise ValueError(f"{len(errors)} severities need as many of the baseline, or their mean; got {len(baseline)}")
    lost = float(np.mean(baseline)) - baseline_clean
    if lost == 0:
        raise ValueError("the baseline loses nothing under this corruption, there is no ratio to it")
    return (float(np.mean(errors)) - clean) / lost


def corruption_score(
    errors: CorruptionErrors, baseline: CorruptionBaseline, corruptions: Sequence[str] | None = None
) -> CorruptionScore:
    """E, mCE and mean relative CE of a model over a set of corruptions, relative to a baseline.

    Args:
        errors: of the model, as shares.
        baseline: whose errors the ratios divide by; see the module.
        corruptions: names of the set, such as :data:`BENCHMARK_15`; by default all that the model was tested on.

    Raises:
        ValueError: the model or the baseline lacks a corruption of the set.

    >>> own = CorruptionErrors(0.1, {"fog": (0.2, 0.4)})  # clean, and at two severities
    >>> score = corruption_score(own, CorruptionBaseline("mine", "run 12", 0.1, {"fog": (0.3, 0.5)}))
    >>> round(score.mean_ce, 2), round(score.mean_relative_ce, 2)  # 0.6 / 0.8, and 0.4 / 0.6 without the clean error
    (0.75, 0.67)
    """
    names = present(corruptions, errors.severities)
    present(names, baseline.errors)
    ce, relative = {}, {}
    for name in names:
        own, other = errors.severities[name], baseline.errors[name]
        ce[name] = corruption_ratio(own, other)
        relative[name] = relative_corruption_ratio(own, errors.clean, other, baseline.clean)
    return CorruptionScore(
        baseline=baseline.name,
        clean=errors.clean,
        error=errors.mean(names),
        mean_ce=float(np.mean(list(ce.values()))),
        mean_relative_ce=float(np.mean(list(relative.values()))),
        ce=ce,
        relative_ce=relative,
    )
