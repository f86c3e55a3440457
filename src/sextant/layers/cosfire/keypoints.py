"""Where a filter answers: peaks of its response, one for each thing found."""

from dataclasses import dataclass

import numpy as np
import torch.nn.functional as F
from jaxtyping import Float
from scipy.cluster.hierarchy import fcluster, linkage
from torch import Tensor


@dataclass(frozen=True)
class Keypoint:
    """A peak: x and y in pixels of the response, and how strong it is."""

    x: int
    y: int
    score: float


def keypoints(response: Float[Tensor, "h w"], *, threshold: float = 0.0, min_distance: float = 8.0) -> list[Keypoint]:
    """Peaks above ``threshold``, the strongest first.

    Peaks closer together than ``min_distance`` pixels are one (clusters by complete linkage), and the strongest speaks
    for them.

    Source: Azzopardi and Petkov 2013, section 3.
    """
    largest = F.max_pool2d(response[None, None], 3, 1, 1)[0, 0]
    found = ((response == largest) & (response > threshold)).nonzero().cpu().numpy()
    if len(found) == 0:
        return []
    scores = response.detach().cpu().numpy()[found[:, 0], found[:, 1]]
    order = np.argsort(-scores, kind="stable")
    found, scores = found[order], scores[order]
    cluster = np.ones(1, dtype=int)
    if len(found) > 1:
        cluster = fcluster(linkage(found.astype(float), "complete"), min_distance, "distance")
    first = sorted(int(np.flatnonzero(cluster == label)[0]) for label in np.unique(cluster))
    return [Keypoint(int(found[i, 1]), int(found[i, 0]), float(scores[i])) for i in first]
