r"""Confidence regions that contain the truth as often as they claim, calibrated on the validation drives.

A belief is too narrow: what a map does not know about a place is wrong in all images taken there, and the errors of a
descriptor are not Gaussian. Neither shows in single images. So a filter is run along the validation drives, and the
reported standard deviations are multiplied by

.. math:: s = \max\!\big(1, \sqrt{q_{95}(\mathrm{NEES}) \,/\, \chi^2_{d,\,95}}\big) ,

with the 95th percentile of the NEES (:mod:`sextant.evaluation.pose_posterior`) of all n steps from
convergence on, the one of rank ⌈0.95 (n + 1)⌉. The 95 % regions then contain the truth in 95 % of these steps. This is
conformal prediction with the NEES as its score (Vovk, Gammerman & Shafer, "Algorithmic Learning in a Random World",
2005). Steps of a drive are not exchangeable, so its guarantee does not hold, and coverage has to be measured on other
drives. The filter's estimates, and when it is lost, do not change, and regions are never made narrower.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy import stats

from sextant.chapters.localization.along_drives import for_validation, outcomes_along
from sextant.chapters.localization.data.localization_data import LocalizationData
from sextant.chapters.localization.judged import axes_of, judge
from sextant.chapters.localization.testing import MakeObservers, Outcome, TestSettings
from sextant.localization.pose_kernel import PoseKernel
from sextant.reporter import Advance

LEVEL = 0.95
#: number of runs along each validation drive: few would not show a filter that is only rarely sure of something wrong
RUNS = 8
#: number of steps below which nothing is learnt, and the largest scale
FEWEST, WIDEST = 50, 10.0


def region_scale(nees: Float64[ndarray, " k"], dof: int) -> float:
    """The factor of standard deviations, in [1, 10].

    Args:
        nees: NEES of the steps from convergence on; inf where the filter was sure of something wrong.
        dof: number of coordinates in the NEES.

    >>> honest = np.random.default_rng(0).chisquare(3, 10_000)
    >>> region_scale(honest / 2, 3), round(region_scale(9 * honest, 3), 1), region_scale(honest[:10], 3)
    (1.0, 3.0, 1.0)
    """
    if len(nees) < FEWEST:
        return 1.0
    rank = min(math.ceil(LEVEL * (len(nees) + 1)), len(nees))
    reached = float(np.partition(nees, rank - 1)[rank - 1])
    return min(max(1.0, math.sqrt(reached / stats.chi2.ppf(LEVEL, dof))), WIDEST)


def scale_along(
    drives: LocalizationData,
    settings: TestSettings,
    make_observers: MakeObservers,
    kernel: PoseKernel,
    progress: Advance | None = None,
) -> float:
    """The :func:`region_scale` of the validation drives; arguments as for ``along_drives``."""
    where = for_validation(drives)
    outcomes = outcomes_along(drives, settings, make_observers, kernel, RUNS, progress)
    found = [judge(outcome, where).nees for outcome in outcomes]
    return region_scale(np.concatenate(found), len(axes_of(where)))


def widened(outcomes: Iterable[Outcome], scale: float) -> Iterator[Outcome]:
    """The same outcomes, with reported standard deviations multiplied by ``scale``."""
    for outcome in outcomes:
        yield replace(outcome, track=replace(outcome.track, covariance=scale**2 * outcome.track.covariance))
