r"""Split-conformal prediction: intervals with guaranteed coverage, whatever the network.

The *score* of an image is its error divided by the expected error that the network predicts, :math:`s = |e| / \sigma`.
From the sorted scores of n validation images, which were not trained on, the interval at level :math:`1 - \alpha` is

.. math:: \hat y \pm q\,\sigma, \qquad q = s_{(\lceil (n + 1)(1 - \alpha) \rceil)} ,

infinite if the rank exceeds n. If a new image is exchangeable with them, the interval covers the truth with probability
at least :math:`1 - \alpha`, and for scores without ties at most :math:`1 - \alpha + 1/(n + 1)`. Both are averages over
validation sets and new images together. For a given validation set, coverage varies by about
:math:`\sqrt{\alpha(1 - \alpha)/n}`, and it is not guaranteed for any particular kind of image. Choosing a checkpoint on
the same validation images makes their scores slightly too small, which is not corrected here.

Crops of one panorama are not exchangeable with those of a new one. With m crops from each of K panoramas, the guarantee
holds for one crop of a new panorama if the new panorama counts as a whole one: the rank among the n = K m scores is
:math:`\lceil (n + m)(1 - \alpha) \rceil`, so that levels above :math:`K/(K + 1)` give infinite intervals.

Sources: J. Lei et al., "Distribution-free predictive inference for regression", JASA 2018; Y. Lee, R. F. Barber,
R. Willett, "Distribution-free inference with hierarchical data", 2023, for clusters.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int64, Integer
from numpy import ndarray
from torch import Tensor

#: levels at which coverage is plotted, and those given in tables
LEVELS = tuple(round(0.05 * step, 2) for step in range(1, 20))
TABLE_LEVELS = (0.5, 0.68, 0.9, 0.95)


@dataclass(frozen=True)
class CoverageCurve:
    """Coverage of intervals on test images, by level; one column for each of k parameters.

    Attributes:
        levels: nominal levels of the intervals.
        coverage: share of images whose interval covers the truth.
        low, high: its 95 % interval from a bootstrap over the test panoramas.
        multipliers: q for each level.
    """

    levels: Float[ndarray, "l"]
    coverage: Float[ndarray, "l k"]
    low: Float[ndarray, "l k"]
    high: Float[ndarray, "l k"]
    multipliers: Float[ndarray, "l k"]


def cluster_resamples(clusters: Int64[ndarray, "n"], resamples: int, seed: int) -> Int64[ndarray, "resamples k"]:
    """How often each cluster is drawn in bootstrap resamples of whole clusters, numbered from 0.

    >>> cluster_resamples(np.array([0, 0, 1]), resamples=4, seed=0).sum(axis=1)  # two clusters, each time two draws
    array([2, 2, 2, 2])
    """
    k = int(clusters.max()) + 1
    return np.random.default_rng(seed).multinomial(k, np.full(k, 1 / k), size=resamples)


def conformal_rank(count: int, level: float, per_panorama: int = 1) -> int:
    """Rank, from 1, of the sorted score that bounds the intervals of a level; a rank above ``count`` means infinity.

    It is ``ceil((n + m) level)``, with products rounded if within rounding error of an integer: 0.55 x 100 is 55.

    Raises:
        ValueError: the level is not in (0, 1), or ``per_panorama`` does not divide ``count``.

    >>> conformal_rank(99, 0.9), conformal_rank(8, 0.9)  # 8 scores are too few for a level of 0.9
    (90, 9)
    >>> conformal_rank(100, 0.9, per_panorama=10)  # of ten panoramas
    99
    """
    if not 0 < level < 1:
        raise ValueError(f"level must lie in (0, 1), got {level}")
    if per_panorama < 1 or count % per_panorama:
        raise ValueError(f"{count} scores cannot be split into panoramas with {per_panorama} each")
    exact = (count + per_panorama) * level
    return round(exact) if math.isclose(exact, round(exact), rel_tol=1e-12) else math.ceil(exact)


def conformal_quantile(scores: Float[Tensor, "n *k"], level: float, per_panorama: int = 1) -> Float[Tensor, "*k"]:
    """Multipliers of the expected errors that give intervals of ``level``; see the module.

    Args:
        scores: of validation images, in any order, one column per parameter.
        level: in (0, 1).
        per_panorama: validation crops of each panorama; with 1, crops count as independent.

    Raises:
        ValueError: as for :func:`conformal_rank`.

    >>> scores = torch.arange(1.0, 100.0)  # 99 of them
    >>> conformal_quantile(scores, 0.9), conformal_quantile(scores[:8], 0.9)
    (tensor(90.), tensor(inf))
    """
    rank = conformal_rank(len(scores), level, per_panorama)
    if rank > len(scores):
        return scores.new_full(scores.shape[1:], torch.inf)
    return scores.nan_to_num(nan=torch.inf, posinf=torch.inf).sort(0).values[rank - 1]


def coverage(scores: Float[Tensor, "n *k"], quantile: Float[Tensor, "*k"]) -> Float[Tensor, "*k"]:
    """Share of test images whose interval covers the truth, given their scores; a score of nan counts as not covered.

    >>> coverage(torch.tensor([0.5, 1.0, 2.0, torch.nan]), torch.tensor(1.0)).item()
    0.5
    """
    return (scores <= quantile).double().mean(0)


def coverage_curve(
    validation: Float[Tensor, "n k"],
    test: Float[Tensor, "t k"],
    panoramas: Integer[ndarray, "t"],
    levels: tuple[float, ...] = LEVELS,
    *,
    per_panorama: int = 1,
    resamples: int = 1000,
    seed: int = 0,
) -> CoverageCurve:
    """Coverage, on test images, of intervals made from validation scores.

    Args:
        validation: scores from which the intervals are made.
        test: scores of the test images.
        panoramas: which panorama each test image was cut from; the bootstrap draws whole panoramas.
        levels: of the intervals.
        per_panorama: validation crops of each panorama.
        resamples: of the bootstrap.
        seed: of the bootstrap.

    Raises:
        ValueError: as for :func:`conformal_rank`.

    >>> validation, test = torch.arange(1.0, 100.0)[:, None], torch.tensor([[10.0], [45.0], [70.0], [95.0]])
    >>> curve = coverage_curve(validation, test, panoramas=np.arange(4), levels=(0.5, 0.9))
    >>> curve.multipliers[:, 0], curve.coverage[:, 0]
    (array([50., 90.]), array([0.5 , 0.75]))
    """
    clusters = np.unique(panoramas, return_inverse=True)[1].astype(np.int64)
    counts = cluster_resamples(clusters, resamples, seed)
    drawn = (counts @ np.bincount(clusters))[:, None]
    multipliers = torch.stack([conformal_quantile(validation, level, per_panorama) for level in levels])
    rows, lows, highs = [], [], []
    for quantile in multipliers:
        held = (test <= quantile).double().cpu().numpy()
        per_cluster = np.stack([np.bincount(clusters, weights=column) for column in held.T], axis=1)
        low, high = np.quantile(counts @ per_cluster / drawn, [0.025, 0.975], axis=0)
        rows.append(held.mean(0))
        lows.append(low)
        highs.append(high)
    return CoverageCurve(
        np.array(levels), np.stack(rows), np.stack(lows), np.stack(highs), multipliers.double().cpu().numpy()
    )
