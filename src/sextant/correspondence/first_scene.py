"""The first guess of a few photos' poses and points, near a given focal length: photo by photo.

Two photos with many points seen from two sides come first. Each further photo is placed by its points, the one that
sees most first, and all is adjusted (:mod:`sextant.correspondence.bundle`) before the next. Three photos or more
correct the focal length, too; until then errors are larger, and larger ones are allowed.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from sextant.correspondence.absolute_pose import absolute_pose
from sextant.correspondence.bundle import LARGEST_PX, Scene, Tracks, errors, fitted
from sextant.correspondence.matching import tracks_of
from sextant.correspondence.pinhole import Pinhole
from sextant.correspondence.triangulation import triangulate

Pair = tuple[int, int]
#: least angle between two rays of a point, and the angle above which more is no better for a first pair
LEAST_ANGLE_DEG, ENOUGH_DEG = 1.0, 10.0
#: points that a photo needs to be placed, and that a scene needs
LEAST = 20
#: points that are kept, those in most photos: time is proportional to their pixels
MOST = 1500
#: variance of a pixel's coordinate while photos are added, and by how much larger errors are allowed
VARIANCE, LARGER = 0.5, 4.0


def joined(links: Mapping[Pair, Int64[ndarray, "m 2"]]) -> tuple[ndarray, ndarray, ndarray]:
    """Tracks of features that are linked, at most one in a photo: their photos, features and tracks, sorted by track.

    >>> joined({(0, 1): np.array([[5, 7]]), (1, 2): np.array([[7, 3]])})[1].tolist()
    [5, 7, 3]
    """
    most = 1 + max(int(pairs.max()) for pairs in links.values())
    ends = np.concatenate([pairs + np.array(photo) * most for photo, pairs in links.items()])
    linked, photo, track = tracks_of(ends, lambda numbers: numbers // most, MOST)
    return photo, linked % most, track


def first_scene(
    tracks: Tracks, focal: float, relative: Mapping[Pair, Float64[ndarray, "4 4"]]
) -> tuple[Tracks, Scene, list[int]] | None:
    """Poses and points of the photos that can be placed, and their numbers; None if there are none.

    Args:
        tracks: what is seen.
        focal: the focal length.
        relative: second camera from first, of pairs.
    """
    tracks = replace(tracks, largest_px=LARGER * LARGEST_PX)
    camera = _camera(tracks, focal)
    pair = max(relative, key=lambda each: _worth(tracks, camera, each, relative[each]), default=None)
    if pair is None or not _worth(tracks, camera, pair, relative[pair]):
        return None
    poses = {pair[0]: np.eye(4), pair[1]: np.linalg.inv(relative[pair])}
    while True:
        made = _scene(tracks, _camera(tracks, focal), focal, poses)
        if made is None:
            return None
        seen, scene, numbers = made
        scene = fitted(seen, scene, VARIANCE, free=len(poses) > 2).scene
        focal = float(np.exp(scene.shared[0]))
        poses = {photo: _inverse(scene, k) for k, photo in enumerate(poses)}
        kept = _right(seen, scene)
        found = dict(zip(numbers[kept].tolist(), scene.points[kept], strict=True))
        pose = _next(tracks, _camera(tracks, focal), poses, found)
        if pose is None:
            seen = replace(seen.only(kept), largest_px=LARGEST_PX)
            return seen, replace(scene, points=scene.points[kept]), list(poses)
        poses |= pose


def _camera(tracks: Tracks, focal: float) -> Pinhole:
    side = int(tracks.side)
    return Pinhole(side, side, focal, focal, 0.0, 0.0)


def _inverse(scene: Scene, photo: int) -> Float64[ndarray, "4 4"]:
    """World from camera."""
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = scene.rotations[photo], scene.translations[photo]
    return np.linalg.inv(found)


def _worth(tracks: Tracks, camera: Pinhole, pair: Pair, relative: ndarray) -> float:
    """Points that two photos see, and from how different sides."""
    both = np.isin(tracks.photos, pair)
    both &= np.bincount(tracks.points[both], minlength=tracks.points.max() + 1)[tracks.points] == 2
    numbers, points = np.unique(tracks.points[both], return_inverse=True)
    if len(numbers) < LEAST:
        return 0.0
    images = (tracks.photos[both] == pair[1]).astype(np.int64)
    poses = np.stack([np.eye(4), np.linalg.inv(relative)])
    found = triangulate(tracks.pixels[both], images, points.reshape(-1), poses, [camera] * 2)
    good = found.valid & (found.errors_px < LARGER * LARGEST_PX) & (found.angles_deg > LEAST_ANGLE_DEG)
    return float(np.minimum(found.angles_deg[good], ENOUGH_DEG).sum()) if good.sum() >= LEAST else 0.0


def _scene(
    tracks: Tracks, camera: Pinhole, focal: float, poses: Mapping[int, ndarray]
) -> tuple[Tracks, Scene, ndarray] | None:
    """The points that photos with poses see, the photos numbered anew, and the former numbers of the points."""
    order = list(poses)
    number = np.full(len(tracks.orientations), -1)
    number[order] = np.arange(len(order))
    placed = number[tracks.photos] >= 0
    placed &= np.bincount(tracks.points[placed], minlength=tracks.points.max() + 1)[tracks.points] >= 2
    if not placed.any():
        return None
    numbers, points = np.unique(tracks.points[placed], return_inverse=True)
    seen = Tracks(
        tracks.pixels[placed],
        number[tracks.photos[placed]],
        points.reshape(-1),
        tracks.orientations[order],
        tracks.side,
    )
    matrices = np.stack([poses[photo] for photo in order])
    found = triangulate(seen.pixels, seen.photos, seen.points, matrices, [camera] * len(order))
    good = found.valid & (found.angles_deg > LEAST_ANGLE_DEG) & (found.errors_px < 2 * LARGER * LARGEST_PX)
    if good.sum() < LEAST:
        return None
    inverse = np.linalg.inv(matrices)
    shared = np.array([np.log(focal), 0.0, *([0.0] * 2 * (1 + int(tracks.orientations.max())))])
    scene = Scene(shared, inverse[:, :3, :3], inverse[:, :3, 3], found.points[good])
    return seen.only(good), scene, numbers[good]


def _right(tracks: Tracks, scene: Scene) -> ndarray:
    """Points with two right pixels at least, and most of theirs right."""
    right = (errors(tracks, scene) ** 2).sum(1) < tracks.largest_px**2
    good, every = np.bincount(tracks.points, right), np.bincount(tracks.points)
    return np.asarray((good >= 2) & (good > every / 2))


def _next(
    tracks: Tracks, camera: Pinhole, poses: Mapping[int, ndarray], points: Mapping[int, ndarray]
) -> dict[int, ndarray] | None:
    """The pose of the photo that sees most of the points; of the next one if it cannot be placed."""
    known = np.isin(tracks.points, list(points))
    counts = np.bincount(tracks.photos[known], minlength=len(tracks.orientations))
    counts[list(poses)] = 0
    for photo in np.argsort(-counts, kind="stable").tolist():
        if counts[photo] < LEAST:
            return None
        rows = known & (tracks.photos == photo)
        there = np.stack([points[number] for number in tracks.points[rows].tolist()])
        found = absolute_pose(tracks.pixels[rows], there, camera, error_px=LARGER * LARGEST_PX)
        if found is not None and found.inliers.sum() >= max(LEAST, rows.sum() / 4):
            return {photo: found.world_from_camera}
    return None
