r"""The best recall@1 that single images allow if some show the same picture, as those from a stopped train do.

Consecutive frames with the same picture form a *run*. A descriptor is a function of the picture: all queries of a run
get the same answer, and the references of a run are returned with equal probability or not at all. The best such
descriptor distinguishes all different images and answers each run of queries Q with the run of references R that is
right most often. Its expected recall@1 is

.. math:: \frac{1}{m} \sum_Q \max_R \sum_{i \in Q} \frac{|P_i \cap R|}{|R|},

where :math:`P_i` are the positives of query i and m is the number of queries. This is the expectation for a perfect
descriptor, not a bound for every method: images of a run differ by noise, and sequences hold more information than
single images.
"""

import numpy as np
from jaxtyping import Bool, Int64
from numpy import ndarray

from sextant.evaluation.positives import Positives


def picture_runs(like_before: Bool[ndarray, "n"]) -> Int64[ndarray, "n"]:
    """Run number of each frame, from 0, where ``like_before`` marks frames that show the previous picture again.

    The first frame always starts a run.

    >>> picture_runs(np.array([False, False, True, True, False]))
    array([0, 1, 1, 1, 2])
    """
    runs = np.cumsum(~np.asarray(like_before, bool))
    return np.asarray(runs - runs[0] if len(runs) else runs, np.int64)


def standstill(like_before: Bool[ndarray, "n"]) -> Bool[ndarray, "n"]:
    """Frames whose picture is also that of the previous or next frame: all members of runs of two or more.

    >>> standstill(np.array([False, False, True, True, False]))
    array([False,  True,  True,  True, False])
    """
    runs = picture_runs(like_before)
    return np.asarray(np.bincount(runs)[runs] > 1) if len(runs) else np.zeros(0, bool)


def single_image_ceiling(
    positives: Positives, query_run: Int64[ndarray, "m"], reference_run: Int64[ndarray, "n"]
) -> float:
    """Expected recall@1 over all queries of a descriptor perfect except for equal pictures; nan without queries.

    Args:
        positives: of m queries among n references.
        query_run, reference_run: the run of each image, see :func:`picture_runs`.

    Raises:
        ValueError: the lengths differ.

    >>> frames, run = np.arange(4), picture_runs(np.array([False, False, True, False]))  # frames 1 and 2 are alike
    >>> single_image_ceiling(Positives.within_frames(frames, frames, 0), run, run)  # one of the two is answered right
    0.75
    """
    if (len(query_run), len(reference_run)) != (len(positives), positives.references):
        raise ValueError(
            f"need runs of {len(positives)} queries and {positives.references} references; "
            f"got {len(query_run)} and {len(reference_run)}"
        )
    if not len(positives):
        return float("nan")
    runs, reference = np.unique(reference_run, return_inverse=True)
    share = 1 / np.bincount(reference)
    queries, query = np.unique(query_run, return_inverse=True)
    pair_query = np.repeat(query, positives.counts)
    pair_reference = reference[positives.indices]
    cells, cell = np.unique(pair_query * len(runs) + pair_reference, return_inverse=True)
    right = np.bincount(cell, weights=share[pair_reference], minlength=len(cells))
    best = np.zeros(len(queries))
    np.maximum.at(best, cells // len(runs), right)
    return float(best.sum() / len(positives))
