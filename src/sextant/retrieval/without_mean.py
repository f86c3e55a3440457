r"""Centring: removes from the descriptors of a traverse what all its images share, such as light, season and camera.

The mean :math:`\bar r` is subtracted from the map's descriptors. From the queries', the mean of all queries is
subtracted (``all``) or, while a traverse goes on (``running``), the mean of those so far, in which the map's mean
counts as ten images:

.. math:: m_t = \frac{10\,\bar r + \sum_{s \le t} q_s}{10 + t}.

The result is scaled to norm one again.
"""

from typing import Literal

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from sextant.errors import ArgumentError
from sextant.ranges import checked

Centring = Literal["none", "running", "all"]
#: weight of the map's mean in a running mean, in images
PRIOR_IMAGES = 10


@checked
def centred(
    reference: Float32[ndarray, "n d"], query: Float32[ndarray, "m d"], centring: Centring
) -> tuple[Float32[ndarray, "n d"], Float32[ndarray, "m d"]]:
    """Descriptors of a map and of queries, each without its mean.

    Args:
        reference: descriptors of the map.
        query: descriptors of the queries, in the order of their traverse.
        centring: which mean is subtracted from the queries; ``none`` leaves both as they are.

    Raises:
        ArgumentError: ``centring`` is unknown, or is ``all`` for a single query.
    """
    if centring == "none":
        return reference, query
    if centring == "all" and len(query) == 1:
        raise ArgumentError("centring=all: a single photo equals its mean, which leaves zero", "centring=running")
    middle = reference.mean(axis=0, dtype=np.float64)
    if centring == "all":
        mean = query.mean(axis=0, dtype=np.float64)
    else:
        seen = np.arange(1, len(query) + 1)[:, None]
        mean = (PRIOR_IMAGES * middle + np.cumsum(query, axis=0, dtype=np.float64)) / (PRIOR_IMAGES + seen)
    return _unit(reference - middle), _unit(query - mean)


def _unit(rows: ndarray) -> Float32[ndarray, "n d"]:
    norms = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(rows / np.where(norms > 0, norms, 1.0), np.float32)
