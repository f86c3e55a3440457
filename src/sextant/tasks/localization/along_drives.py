r"""How much an image counts along a drive, where images that follow one another err alike.

A tempering that is fitted to single images (:mod:`sextant.localization.calibration`) makes the posterior of one image
as sure as it is right. A filter multiplies the likelihoods of many as if they erred independently, but what a map does
not know about a place is wrong in all images taken there, and the belief grows far too narrow. So the filter itself is
asked: along the validation drives an image counts by the share

.. math:: \rho = \arg\min_{\rho \in \{1, 1/2, 1/4, \dots\}} \frac1{TR} \sum_{t, r}
   -\log\!\big(m_{tr}\, \mathcal N(x^*_{tr};\, \hat x_{tr}, P_{tr}) + 1/V\big)

of the tempering :math:`\beta` that makes the true poses :math:`x^*` likeliest: under the pose :math:`\hat x` and the
covariance P that are told, which the heaviest mode of weight m has, or anywhere in the volume V of the map. The
logarithm is a proper score: a belief too narrow loses by it, and so does one wider than it need be or found late.

Source of the idea: likelihoods that count dependent data as independent are raised to a power, as composite likelihoods
are: F. Pauli, W. Racugno, L. Ventura, "Bayesian composite marginal likelihoods", Statistica Sinica 21, 2011. Theirs
follows from the curvature and the variance of the score; ours from what a filter is for.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float64
from numpy import ndarray

from sextant.data.localization.faults import NoFault
from sextant.data.localization.localization_data import LocalizationData
from sextant.evaluation.localization.pose_posterior import PLANE, RAILWAY, pose_errors
from sextant.localization.localize import Track
from sextant.localization.map_prior import half_spacing
from sextant.localization.pose_kernel import PoseKernel
from sextant.tasks.localization.test import MakeObservers, TestSettings, run_trials

#: runs along each validation drive, and steps of each, at most
RUNS, STEPS = 4, 100
#: shares in a row that are no better, upon which the search ends; and the smallest
PATIENCE, LEAST = 2, 2.0**-10
#: steps whose scores count as one
BLOCK = 20
#: of what is told: in spacings of the map, and in rad
FLOOR, FLOOR_HEADING = 0.05, math.radians(0.5)


def best_share(scores: Callable[[float], Float64[ndarray, " b"]]) -> float:
    r"""The largest share of the tempering, of 1, 1/2, 1/4 and so on, that is not certainly worse than the best.

    Drives for validation are short, and one place that the map does not know may be half of them. So a share has to
    beat a larger one by more than the standard error of their difference.

    Args:
        scores: of stretches of drives at a share, lower is better.

    >>> best_share(lambda share: np.array([0.1, -0.1, 0.0]) + abs(share - 0.2))
    0.25
    >>> best_share(lambda share: np.array([5 * share, 0.0, -4 * share]))  # better in one stretch, worse in another
    1.0
    """
    found, best, share = {1.0: scores(1.0)}, 1.0, 0.5
    while share >= LEAST and best < share * 2.0 ** (PATIENCE + 1):
        found[share] = scores(share)
        best = share if found[share].mean() < found[best].mean() else best
        share /= 2
    worse = {share: each - found[best] for share, each in found.items()}
    return max(share for share, by in worse.items() if by.mean() <= by.std(ddof=1) / math.sqrt(len(by)))


def told_nll(
    truth: Float64[ndarray, "*n 3"],
    told: Track,
    axes: tuple[int, ...],
    floor: tuple[float, float, float],
    volume: float,
) -> Float64[ndarray, "*n"]:
    """Of true poses under what was told of them, in nats.

    Args:
        truth: of steps and runs.
        told: of the same.
        axes: coordinates that count.
        floor: standard deviations that are not told apart from none.
        volume: that a robot which is not where it is told to be is anywhere in.
    """
    error = pose_errors(truth, told.pose)[..., axes]
    covariance = told.covariance[..., axes, :][..., axes] + np.diag(np.square(floor))[axes, :][:, axes]
    squared = (error * np.linalg.solve(covariance, error[..., None])[..., 0]).sum(-1)
    density = -(squared + np.linalg.slogdet(covariance)[1] + len(axes) * math.log(2 * math.pi)) / 2
    with np.errstate(divide="ignore"):
        return np.asarray(-np.logaddexp(np.log(told.mass) + density, -math.log(volume)))


def nll_along(
    drives: LocalizationData, settings: TestSettings, make_observers: MakeObservers, kernel: PoseKernel
) -> Float64[ndarray, " b"]:
    """Of the true poses of stretches of the validation drives in nats.

    Args:
        drives: of which those for validation are localized.
        settings: of the filter; runs are fewer and shorter.
        make_observers: as for :func:`~sextant.tasks.localization.test.run_trials`.
        kernel: that was learnt.
    """
    where = drives.map if drives.validation_map is None else drives.validation_map
    asked = replace(drives, map=where, test=drives.validation, validation=(), validation_map=None)
    few = replace(
        settings,
        particle_counts=settings.particle_counts[:1],
        starts=min(settings.starts, RUNS),
        horizon=min(settings.horizon, STEPS),
        replay=False,
    )
    spacing = 2 * half_spacing(torch.from_numpy(where.poses))
    across = np.ptp(where.poses[:, :2], axis=0) + 2 * spacing
    axes, volume = (PLANE, across.prod() * 2 * math.pi) if drives.unit == "m" else (RAILWAY, across[0])
    floor = (FLOOR * spacing, FLOOR * spacing, FLOOR_HEADING)
    found = []
    for outcome in run_trials(asked, {"none": NoFault()}, few, make_observers, kernel=kernel):
        nll = told_nll(outcome.runs.poses, outcome.track, axes, floor, float(volume))
        for run, inside in zip(nll.T, outcome.runs.inside.T, strict=True):
            kept = run[inside]
            found += [block.mean() for block in np.array_split(kept, -(-len(kept) // BLOCK))] if len(kept) else []
    return np.array(found)
