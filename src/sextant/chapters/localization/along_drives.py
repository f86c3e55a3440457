r"""The weight of an image along a drive, where the errors of consecutive images are correlated.

A tempering fitted to single images (:mod:`sextant.localization.calibration`) calibrates the posterior of one image. A
filter multiplies the likelihoods of many images as if their errors were independent. But the errors of a map at a place
are common to all images taken there, so that the belief becomes too narrow. With ``likelihood.tempering=along_drives``
only a share :math:`\rho` of that tempering is used. It is chosen by the score of the filter along the validation
drives, the mean over all steps of

.. math:: -\log\!\big(m\, \mathcal N(x^*;\, \hat x, P) + (1 - m) / V\big) :

the density of the true pose :math:`x^*` under a Gaussian at the reported pose :math:`\hat x` with the covariance P of
its mode, weighted by the mass m of that mode, and under a uniform density over the volume V of the map. Shares 1, 1/2,
1/4, ... are tried until two in a row are no better. The largest of them within a standard error of the best is taken.

Sources: P. Grünwald, "The Safe Bayesian", ALT 2012, which chooses the power of a likelihood by the logarithmic loss of
predictions along a sequence; L. Breiman et al., "Classification and Regression Trees", 1984, for the rule of one
standard error.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float64
from numpy import ndarray
from scipy import stats

from sextant.chapters.localization.data.drive import LocalizationData
from sextant.chapters.localization.data.faults import NoFault
from sextant.chapters.localization.judged import axes_of, judge
from sextant.chapters.localization.testing import MakeObservers, Outcome, TestSettings, run_trials
from sextant.evaluation.pose_posterior import PLANE, RAILWAY, pose_errors
from sextant.localization.localize import Track
from sextant.localization.map_prior import half_spacing
from sextant.localization.pose_kernel import PoseKernel
from sextant.reporter import Advance

#: largest number of runs along each validation drive, and of steps in each; the test drives are not used
RUNS, STEPS = 4, 100
#: number of consecutive shares without improvement that ends the search, and the smallest share
PATIENCE, LEAST = 2, 2.0**-10
#: number of consecutive frames of a drive whose scores are averaged into one
STRETCH = 20
#: the smallest standard deviations of a reported pose: of its position in spacings of the map, of its heading in rad
FLOOR, FLOOR_HEADING = 0.05, math.radians(0.5)
#: smallest mass of the uniform density
BACKGROUND = 1e-3


def best_share(scores: Callable[[float], Float64[ndarray, " b"]]) -> float:
    r"""The largest share of the tempering, out of 1, 1/2, 1/4 and so on, within a standard error of the best.

    Args:
        scores: returns scores of stretches of drives at a share, lower is better; with fewer than two the share is 1.

    >>> best_share(lambda share: np.array([0.1, -0.1, 0.0]) + abs(share - 0.2))
    0.25
    >>> best_share(lambda share: np.array([5 * share, 0.0, -4 * share]))  # better in one stretch, worse in another
    1.0
    """
    found, best, share = {1.0: scores(1.0)}, 1.0, 0.5
    if len(found[1.0]) < 2:
        return 1.0
    while share >= LEAST and best < share * 2.0 ** (PATIENCE + 1):
        found[share] = scores(share)
        best = share if found[share].mean() < found[best].mean() else best
        share /= 2
    worse = {share: each - found[best] for share, each in found.items()}
    near = [share for share, by in worse.items() if by.mean() <= by.std(ddof=1) / math.sqrt(len(by))]
    return max([best, *near])


def reported_pose_nll(
    truth: Float64[ndarray, "*n 3"],
    track: Track,
    axes: tuple[int, ...],
    floor: tuple[float, float, float],
    volume: float,
) -> Float64[ndarray, "*n"]:
    r"""Negative log-likelihood :math:`-\log(m \mathcal N(x^*; \hat x, P) + (1 - m) / V)` of true poses, in nats.

    Args:
        truth: x, y and heading in rad, by step and run.
        track: the filter's estimates there.
        axes: coordinates that count.
        floor: standard deviations added to those reported, so that none is zero.
        volume: V, the volume of the map: its unit squared times rad, or its unit for a railway.
    """
    error = pose_errors(truth, track.pose)[..., axes]
    covariance = track.mode_covariance[..., axes, :][..., axes] + np.diag(np.square(floor))[axes, :][:, axes]
    squared = (error * np.linalg.solve(covariance, error[..., None])[..., 0]).sum(-1)
    density = -(squared + np.linalg.slogdet(covariance)[1] + len(axes) * math.log(2 * math.pi)) / 2
    mass = (1 - BACKGROUND) * np.clip(track.mass, 0.0, 1.0)
    with np.errstate(divide="ignore"):
        return np.asarray(-np.logaddexp(np.log(mass) + density, np.log1p(-mass) - math.log(volume)))


def for_validation(drives: LocalizationData) -> LocalizationData:
    """The data with the validation drives and their map in place of those of the test."""
    where = drives.map_of_validation
    return replace(drives, map=where, test=drives.validation, validation=(), validation_map=None, corrupted=())


def outcomes_along(
    drives: LocalizationData,
    settings: TestSettings,
    make_observers: MakeObservers,
    kernel: PoseKernel,
    runs: int = RUNS,
    progress: Advance | None = None,
) -> Iterator[Outcome]:
    """Run the filter along the validation drives, a few runs of each, with the most particles and no faults."""
    usual = replace(
        settings,
        particle_counts=(max(settings.particle_counts),),
        starts=runs,
        horizon=STEPS,
        every=1,
        replay=False,
    )
    yield from run_trials(for_validation(drives), {"none": NoFault()}, usual, make_observers, progress, kernel)


def nll_along(
    drives: LocalizationData,
    settings: TestSettings,
    make_observers: MakeObservers,
    kernel: PoseKernel,
    progress: Advance | None = None,
) -> Float64[ndarray, " b"]:
    """Means of :func:`reported_pose_nll` over stretches of the validation drives, each over all runs through it.

    Args:
        drives: data whose validation drives are localized.
        settings: settings of the filter.
        make_observers: as for :func:`~sextant.chapters.localization.testing.run_trials`.
        kernel: the learnt kernel.
        progress: called with the number of drives done and the total.
    """
    where = for_validation(drives).map
    spacing = 2 * half_spacing(torch.from_numpy(where.poses))
    across = np.ptp(where.poses[:, :2], axis=0) + 2 * spacing
    axes, volume = (PLANE, across.prod() * 2 * math.pi) if drives.unit == "m" else (RAILWAY, across[0])
    floor = (FLOOR * spacing, FLOOR * spacing, FLOOR_HEADING)
    scores = []
    for outcome in outcomes_along(drives, settings, make_observers, kernel, progress=progress):
        runs = outcome.runs
        nll = reported_pose_nll(runs.poses, outcome.track, axes, floor, float(volume))[runs.inside]
        stretch = runs.frames[runs.inside] // STRETCH
        scores += [float(nll[stretch == number].mean()) for number in np.unique(stretch)]
    return np.array(scores)


LEVEL = 0.95
#: number of runs along each validation drive: too few would miss a filter that is rarely but confidently wrong
REGION_RUNS = 8
#: number of steps below which no scale is fitted, and the largest scale
FEWEST, WIDEST = 50, 10.0


def region_scale(nees: Float64[ndarray, " k"], dof: int) -> float:
    r"""The factor of standard deviations, in [1, 10].

    Beliefs are too narrow: the errors of a map at a place are common to all images taken there, and descriptor errors
    are not Gaussian. Neither effect appears in single images, so a filter is run along the validation drives, and the
    reported standard deviations are multiplied by

    .. math:: s = \max\!\big(1, \sqrt{q_{95}(\mathrm{NEES}) \,/\, \chi^2_{d,\,95}}\big) ,

    with the 95th percentile of the NEES (:mod:`sextant.evaluation.pose_posterior`) of all n steps from
    convergence on, the value of rank ⌈0.95 (n + 1)⌉. The 95 % regions then contain the truth in 95 % of these steps.
    This is conformal prediction with the NEES as its score (Vovk, Gammerman & Shafer, "Algorithmic Learning in a Random
    World", 2005). Steps of a drive are not exchangeable, so its guarantee does not hold, and coverage has to be
    measured on other drives. Estimates and the decision whether the filter is lost do not change, and regions are never
    narrowed.

    Args:
        nees: NEES of the steps from convergence on; inf where all particles agreed on a wrong value.
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
    """The :func:`region_scale` of the validation drives; arguments as for :func:`nll_along`."""
    where = for_validation(drives)
    outcomes = outcomes_along(drives, settings, make_observers, kernel, REGION_RUNS, progress)
    found = [judge(outcome, where).nees for outcome in outcomes]
    return region_scale(np.concatenate(found), len(axes_of(where)))


def widened(outcomes: Iterable[Outcome], scale: float) -> Iterator[Outcome]:
    """The same outcomes, with reported standard deviations multiplied by ``scale``."""
    for outcome in outcomes:
        yield replace(outcome, track=replace(outcome.track, covariance=scale**2 * outcome.track.covariance))
