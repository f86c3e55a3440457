"""Which other convention of poses agrees with matches, where the given one does not."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.correspondence.local_features import LocalFeatures, Matcher
from sextant.correspondence.matching import mutual_matches
from sextant.correspondence.pinhole import Pinhole
from sextant.correspondence.posed_map import agreeing, neighbouring
from sextant.correspondence.triangulation import triangulate

#: pairs of images that a convention is judged by, and the least share of their matches that it makes points:
#: wrong poses agree with few by chance, and half of the matches of neighbours are right in ordinary scenes
PAIRS, LEAST_SHARE = 8, 0.25
_TURNED = np.diag([1.0, -1.0, -1.0, 1.0])
_LEFT = np.diag([1.0, -1.0, 1.0, 1.0])
_ROLLED = np.diag([-1.0, -1.0, 1.0, 1.0])


def _alternatives(poses: ndarray) -> dict[str, ndarray]:
    inverse = np.linalg.inv(poses)
    return {
        "y up and z back (OpenGL, Blender, nerfstudio)": poses @ _TURNED,
        "x left and y up (PyTorch3D)": poses @ _ROLLED,
        "camera_from_world (COLMAP's matrices), to be inverted": inverse,
        "camera_from_world with y up and z back, to be inverted": inverse @ _TURNED,
        "y up and z forward, left-handed (Unity)": _LEFT @ poses @ _LEFT,
    }


def likely_convention(
    features: Sequence[LocalFeatures],
    poses: Float64[ndarray, "n 4 4"],
    cameras: Sequence[Pinhole],
    match: Matcher = mutual_matches,
) -> str | None:
    """The convention that the poses probably have; None if no other agrees much better than the given one."""
    given = agreement(features, poses, cameras, match)
    shares = {name: agreement(features, other, cameras, match) for name, other in _alternatives(poses).items()}
    best = max(shares, key=lambda name: shares[name])
    return best if shares[best] > max(LEAST_SHARE, 2 * given) else None


def agreement(
    features: Sequence[LocalFeatures],
    poses: Float64[ndarray, "n 4 4"],
    cameras: Sequence[Pinhole],
    match: Matcher = mutual_matches,
) -> float:
    """The share of matches that are points in front of both cameras, of some pairs of neighbours."""
    pairs = neighbouring(poses)
    right, total = 0, 0
    for i, j in pairs[:: max(1, len(pairs) // PAIRS)]:
        matches = match(features[i], features[j])
        total += len(matches)
        matches = matches[agreeing(features, poses, cameras, i, j, matches)]
        pixels = np.concatenate([features[i].points[matches[:, 0]], features[j].points[matches[:, 1]]])
        images, tracks = np.repeat([i, j], len(matches)), np.tile(np.arange(len(matches)), 2)
        right += int(triangulate(pixels.astype(np.float64), images, tracks, poses, list(cameras)).valid.sum())
    return right / total if total else 0.0
