"""Keypoints of a filter: peaks of its response, one per detection."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.cluster.hierarchy import fcluster, linkage
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.layers.cosfire.strategies import peaks
from sextant.layers.floating import require_floating


@dataclass(frozen=True)
class Keypoint:
    """A peak: x and y in pixels of the response, and how strong it is."""

    x: int
    y: int
    score: float


def keypoints(
    response: Float[Tensor, "h w"], *, threshold: float = 0.0, min_distance: float = 8.0, most: int = 5000
) -> list[Keypoint]:
    """Peaks of at least ``threshold``, the strongest first.

    Peaks closer together than ``min_distance`` pixels count as one (clusters by complete linkage), represented by the
    strongest. A level response has no peak.

    >>> response = torch.zeros(32, 32)
    >>> response[10, 20] = 0.9
    >>> keypoints(response, threshold=0.5)
    [Keypoint(x=20, y=10, score=0.8999999761581421)]

    Args:
        most: number of strongest peaks considered: memory for clustering grows with its square.

    Raises:
        UserError: the response is not floating-point.
        ArgumentError: the response, ``threshold`` or ``min_distance`` is nan.

    Source: Azzopardi and Petkov 2013, section 3.
    """
    if math.isnan(threshold) or math.isnan(min_distance):
        raise ArgumentError(f"threshold={threshold} and min_distance={min_distance} must be numbers")
    if bool(require_floating(response, "response").isnan().any()):
        raise ArgumentError("response has values that are nan", "Give a response to images without nan.")
    found = (peaks(response.detach()[None])[0] & (response >= threshold)).nonzero()
    scores = response.detach()[found[:, 0], found[:, 1]]
    order = torch.argsort(scores, descending=True, stable=True)[:most]
    places, scores = found[order].cpu().numpy(), scores[order].cpu()
    if len(places) == 0:
        return []
    cluster = np.ones(1, dtype=int)
    if len(places) > 1:
        cluster = fcluster(linkage(places.astype(float), "complete"), min_distance, "distance")
    _, first = np.unique(cluster, return_index=True)
    return [Keypoint(int(places[i, 1]), int(places[i, 0]), float(scores[i])) for i in sorted(first)]
