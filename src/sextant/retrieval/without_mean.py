r"""Descriptors of a traverse without what all its images share: light, season, the camera.

The map's descriptors are taken less their mean :math:`\bar r`; those of the queries less the mean of all queries
(``all``), or, while a ride goes on (``running``), less the mean of those so far, for which the map's stands in with the
weight of ten images:

.. math:: m_t = \frac{10\,\bar r + \sum_{s \le t} q_s}{10 + t}.

What is left has norm one again.
"""

from typing import Literal, get_args

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from sextant.errors import ArgumentError

Centring = Literal["none", "running", "all"]
CENTRINGS: tuple[Centring, ...] = get_args(Centring)
#: images that the mean of the map counts as, before a ride has any of its own
PRIOR_IMAGES = 10


def centred(
    reference: Float32[ndarray, "n d"], query: Float32[ndarray, "m d"], centring: Centring
) -> tuple[Float32[ndarray, "n d"], Float32[ndarray, "m d"]]:
    """Descriptors of a map and of queries, each without its mean.

    Args:
        reference: of the map.
        query: of the queries, in the order of their ride.
        centring: whose mean the queries lose; ``none`` leaves both as they are.

    Raises:
        ArgumentError: there is no such centring, or one query is to lose its own mean.
    """
    if centring not in CENTRINGS:
        raise ArgumentError(f"centring={centring} must be one of {', '.join(CENTRINGS)}", "centring=none")
    if centring == "none":
        return reference, query
    if centring == "all" and len(query) == 1:
        raise ArgumentError("centring=all: one photo is its own mean, and nothing is left of it", "centring=running")
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
