r"""A map of images at known poses whose matched features are points of the world, and the pose of another image in it.

Features of neighbouring images are matched, and matches that contradict the known poses are discarded by their Sampson
error. What remains is joined to tracks, and each track is triangulated once. A query's features are matched to those of
candidate images that have points, and absolute pose follows.

Whether the agreement of k of m matches is more than chance is decided a contrario (Moisan and Stival 2004): the number
of false alarms of a pose is the expected number of poses that are as well supported by matches placed at random,

.. math:: \mathrm{NFA} = 4 (m - 3) \binom{m}{k} \binom{k}{3} p^{k - 3}, \qquad p = \pi r^2 / (w h),

for minimal samples of three points with up to four poses, and inliers within r pixels of an image of w x h.

Chance is not all that agrees with a wrong place: things that look alike do. There, much of what the map shows beside
them is missing in the query (:func:`share_seen`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated

import numpy as np
from annotated_types import Ge
from jaxtyping import Bool, Float64, Int32, Int64
from numpy import ndarray
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree

from sextant.correspondence.absolute_pose import FOCAL_LENGTHS, LEAST_VARIANCE, EstimatedPose, absolute_pose
from sextant.correspondence.local_features import LocalFeatures, Matcher
from sextant.correspondence.matching import mutual_matches, tracks_of
from sextant.correspondence.pinhole import Pinhole, cross_matrices, sampson_errors
from sextant.correspondence.triangulation import triangulate
from sextant.errors import ArgumentError
from sextant.ranges import Count, Positive, checked

#: images that each image of the map is matched to, and the largest angle between their viewing directions
NEIGHBOURS, WIDEST_DEG = 8, 60.0
#: nearest images among which those are sought; of a hundred at one place, an eighth face one way
NEAREST = 256
#: tracks that are triangulated together, which bounds the memory
TRACKS = 200_000
#: errors of a correct match, in pixels of the image that the features were detected in
ERROR_PX = 2.0
#: least angle between two rays of a point: below it the depth is unknown
LEAST_ANGLE_DEG = 1.0


@dataclass(frozen=True)
class PoseErrors:
    r"""By how much poses in a map err more than the noise of pixels and points says.

    A covariance :math:`\Sigma` becomes :math:`c \Sigma + \mathrm{diag}(d^2, d^2, d^2, r^2, r^2, r^2)`.

    Attributes:
        scale: c.
        displacement, rotation: d and r, in units of the map and radians.
        focal: by which variances of focal lengths are multiplied.

    Example:
        >>> PoseErrors(4.0, 0.1).of(np.eye(6)).diagonal().round(2).tolist()
        [4.01, 4.01, 4.01, 4.0, 4.0, 4.0]
    """

    scale: float = 1.0
    displacement: float = 0.0
    rotation: float = 0.0
    focal: float = 1.0

    def of(self, covariance: Float64[ndarray, "*n 6 6"]) -> Float64[ndarray, "*n 6 6"]:
        """The covariance with these errors."""
        return self.scale * covariance + np.diag(np.repeat([self.displacement**2, self.rotation**2], 3))


@dataclass(frozen=True, eq=False)
class PosedMap:
    """Features of images at known poses.

    Attributes:
        features: of each image.
        poses: ``world_from_camera`` of each image.
        cameras: of each image.
        points: of the world.
        covariances: of the points, for the standard deviation of a pixel that their reprojection errors show.
        point_of: for each image, the number of each feature's point, or -1.
        pixel_variance: of a coordinate of the map's pixels, in pixels of the pictures that they were detected in.
        errors: of poses beyond those of pixels and points, see :mod:`sextant.correspondence.left_out`.
        match: matches the features of two images.
    """

    features: Sequence[LocalFeatures]
    poses: Float64[ndarray, "n 4 4"]
    cameras: Sequence[Pinhole]
    points: Float64[ndarray, "p 3"]
    covariances: Float64[ndarray, "p 3 3"]
    point_of: Sequence[Int32[ndarray, "_"]]
    pixel_variance: float = 1.0
    errors: PoseErrors = PoseErrors()
    match: Matcher = mutual_matches

    @property
    def nbytes(self) -> int:
        """Memory of features and points."""
        return sum(each.nbytes for each in self.features) + self.points.nbytes + self.covariances.nbytes

    def matches(
        self, query: LocalFeatures, candidates: Sequence[int]
    ) -> tuple[Int64[ndarray, "m"], Int64[ndarray, "m"], Int64[ndarray, "m"]]:
        """Matches of a query with points: its features, the points, and the images that they were matched in."""
        found = [np.empty((0, 3), np.int64)]
        for image in candidates:
            known = np.flatnonzero(self.point_of[image] >= 0)
            theirs = self.features[image]
            pairs = self.match(
                query, replace(theirs, points=theirs.points[known], descriptors=theirs.descriptors[known])
            )
            numbers = self.point_of[image][known[pairs[:, 1]]]
            found.append(np.column_stack([pairs[:, 0], numbers, np.full(len(pairs), image)]))
        table = np.concatenate(found)
        _, first = np.unique(table[:, :2], axis=0, return_index=True)  # a point that several images match counts once
        return tuple(table[np.sort(first)].T)

    def locate(
        self, query: LocalFeatures, candidates: Sequence[int], camera: Pinhole, focal_sigma: float | None = 0.0
    ) -> "Located":
        """The pose of a query among candidate images; arguments as for :func:`absolute_pose`."""
        rows, numbers, images = self.matches(query, candidates)
        unit = query.pixel
        pose = absolute_pose(
            query.points[rows].astype(np.float64),
            self.points[numbers],
            camera,
            focal_sigma=focal_sigma,
            covariances=self.covariances[numbers],
            error_px=2 * ERROR_PX * unit,
        )
        if pose is not None:
            wider, sigma = self.errors.of(pose.covariance), pose.focal_sigma * math.sqrt(self.errors.focal)
            pose = replace(pose, covariance=wider, focal_sigma=sigma)
        inliers = 0 if pose is None else int(pose.inliers.sum())
        alarms = log_false_alarms(len(rows), inliers, 2 * ERROR_PX * unit, query.width * query.height)
        seen = 0.0 if pose is None else share_seen(self, pose, numbers, images)
        return Located(pose, rows, numbers, images, alarms, seen)


@dataclass(frozen=True, eq=False)
class Located:
    """A query in a map.

    Attributes:
        pose: None if no pose agrees with four matches.
        features: the matched features of the query.
        points: the points that they match.
        images: the images of the map that they were matched in.
        log10_false_alarms: decimal logarithm of the number of false alarms; below 0, more than chance.
        seen: the share of :func:`share_seen`.
    """

    pose: EstimatedPose | None
    features: Int64[ndarray, "m"]
    points: Int64[ndarray, "m"]
    images: Int64[ndarray, "m"]
    log10_false_alarms: float
    seen: float = 0.0


def share_seen(
    posed: PosedMap, pose: EstimatedPose, numbers: Int64[ndarray, "m"], images: Int64[ndarray, "m"]
) -> float:
    """Of the points of an image of the map that lie within a query by its pose, the share that inliers match.

    The image is that with the most inliers, which sees the scene from nearby, so that little is hidden from the query.

    Args:
        posed: the map.
        pose: of the query.
        numbers, images: of the points that the query's features match, and the images that they were matched in.
    """
    if not pose.inliers.any():
        return 0.0
    own = posed.point_of[int(np.bincount(images[pose.inliers]).argmax())]
    own = own[own >= 0]
    inside = (posed.points[own] - pose.world_from_camera[:3, 3]) @ pose.world_from_camera[:3, :3]
    pixels = pose.camera.project(inside)
    size = (pose.camera.width - 1, pose.camera.height - 1)
    within = (inside[:, 2] > 0) & (pixels >= 0).all(1) & (pixels <= size).all(1)
    return float(np.isin(own[within], numbers[pose.inliers]).mean()) if within.any() else 0.0


def build_map(
    features: Sequence[LocalFeatures],
    poses: Float64[ndarray, "n 4 4"],
    cameras: Sequence[Pinhole],
    match: Matcher = mutual_matches,
) -> PosedMap:
    """Match the images of a map, and triangulate what agrees with their poses."""
    offsets = np.cumsum([0, *(len(each) for each in features)])
    links = [np.empty((0, 2), np.int64)]
    for i, j in neighbouring(poses):
        pairs = match(features[i], features[j])
        kept = pairs[agreeing(features, poses, cameras, i, j, pairs)]
        links.append(kept + offsets[[i, j]])
    return replace(_triangulated(features, poses, cameras, np.concatenate(links), offsets), match=match)


def neighbouring(poses: Float64[ndarray, "n 4 4"]) -> list[tuple[int, int]]:
    """Pairs of images that may show the same: the nearest of each that look in a similar direction."""
    position, ahead = poses[:, :3, 3], poses[:, :3, 2]
    nearest = cKDTree(position).query(position, min(NEAREST, len(poses)))[1].reshape(len(poses), -1)
    facing = np.einsum("nkj,nj->nk", ahead[nearest], ahead) > math.cos(math.radians(WIDEST_DEG))
    facing &= nearest != np.arange(len(poses))[:, None]
    first, place = np.nonzero(facing & (np.cumsum(facing, axis=1) <= NEIGHBOURS))
    pairs = np.sort(np.column_stack([first, nearest[first, place]]), axis=1)
    return [(i, j) for i, j in np.unique(pairs, axis=0).tolist()]


def focal_length_of(
    features: Sequence[LocalFeatures], poses: Float64[ndarray, "n 4 4"], match: Matcher = mutual_matches
) -> float | None:
    """The focal length, in longer sides of the images, under which most matches agree with the poses; None: too few."""
    matched = []
    for i, j in neighbouring(poses)[:: max(1, len(poses) // 8)]:
        pairs = match(features[i], features[j])
        matched.append((i, j, pairs))
    if sum(len(pairs) for _, _, pairs in matched) < 50:
        return None

    def loss(log_focal: float) -> float:
        total = 0.0
        for i, j, pairs in matched:
            views = {k: _of_focal_length(features[k], math.exp(log_focal)) for k in (i, j)}
            error = _contradiction(features, poses, views, i, j, pairs)
            total += float(np.minimum(error / (ERROR_PX * features[i].pixel), 1.0).sum())
        return total

    start = min(np.log(FOCAL_LENGTHS).tolist(), key=loss)
    return math.exp(minimize_scalar(loss, bounds=(start - 0.2, start + 0.2), method="bounded").x)


def _of_focal_length(features: LocalFeatures, focal: float) -> Pinhole:
    return Pinhole.centred(features.width, features.height, focal * max(features.width, features.height))


@checked
def log_false_alarms(
    matches: Annotated[int, Ge(0)], inliers: Annotated[int, Ge(0)], radius_px: Positive, pixels: Count
) -> float:
    """Decimal logarithm of the number of false alarms of the module's equation.

    Raises:
        ArgumentError: an argument is out of range, or there are more inliers than matches.

    Example:
        >>> round(log_false_alarms(100, 40, 4.0, 640 * 480), 1), log_false_alarms(100, 4, 4.0, 640 * 480) > 0
        (-105.4, True)
    """
    if inliers > matches:
        raise ArgumentError(f"inliers={inliers} must be at most matches={matches}")
    if inliers < 4:
        return math.inf
    chance = min(1.0, math.pi * radius_px**2 / pixels)
    ways = math.log(4 * (matches - 3)) + math.log(math.comb(matches, inliers)) + math.log(math.comb(inliers, 3))
    return (ways + (inliers - 3) * math.log(chance)) / math.log(10)


def agreeing(
    features: Sequence[LocalFeatures], poses: ndarray, cameras: Sequence[Pinhole], i: int, j: int, pairs: ndarray
) -> Bool[ndarray, "m"]:
    """Which matches agree with the poses of both images."""
    return _contradiction(features, poses, cameras, i, j, pairs) < ERROR_PX * max(features[i].pixel, features[j].pixel)


def _contradiction(
    features: Sequence[LocalFeatures],
    poses: ndarray,
    cameras: Sequence[Pinhole] | Mapping[int, Pinhole],
    i: int,
    j: int,
    pairs: ndarray,
) -> Float64[ndarray, "m"]:
    """Sampson errors of matches under the poses, pixels; infinite where the images have one position."""
    relative = np.linalg.inv(poses[j]) @ poses[i]
    baseline = float(np.linalg.norm(relative[:3, 3]))
    if baseline < 1e-9:
        return np.full(len(pairs), np.inf)
    essential = cross_matrices(relative[None, :3, 3] / baseline)[0] @ relative[:3, :3]
    one = cameras[i].rays(features[i].points[pairs[:, 0]].astype(np.float64))
    two = cameras[j].rays(features[j].points[pairs[:, 1]].astype(np.float64))
    error = np.abs(sampson_errors(one[:, :2], two[:, :2], essential))
    return np.asarray(error * max(cameras[i].fx, cameras[j].fx))


def _triangulated(
    features: Sequence[LocalFeatures], poses: ndarray, cameras: Sequence[Pinhole], links: ndarray, offsets: ndarray
) -> PosedMap:
    """Join links between features to tracks, and triangulate them."""
    linked, image, tracks = tracks_of(links, lambda numbers: np.searchsorted(offsets, numbers, side="right") - 1)
    feature = linked - offsets[image]
    pixels, order = np.empty((len(linked), 2)), np.argsort(image, kind="stable")
    for part in np.split(order, np.flatnonzero(np.diff(image[order])) + 1):
        if len(part):
            pixels[part] = features[image[part[0]]].points[feature[part]]
    unit = np.array([each.pixel for each in features])
    points, covariances, kept, pixel = _triangulated_tracks(pixels, image, tracks, poses, cameras, unit)
    number = np.where(kept, np.cumsum(kept) - 1, -1)
    point_of = np.full(int(offsets[-1]), -1, np.int32)
    point_of[linked] = number[tracks]
    each = [point_of[start:end] for start, end in pairwise(offsets)]
    return PosedMap(features, poses, cameras, points[kept], pixel * covariances[kept], each, pixel)


def _triangulated_tracks(
    pixels: ndarray, image: ndarray, tracks: ndarray, poses: ndarray, cameras: Sequence[Pinhole], unit: ndarray
) -> tuple[ndarray, ndarray, ndarray, float]:
    """Points, their covariances for one pixel, whether they are kept, and the variance of a pixel, of sorted tracks."""
    parts, squared, freedom = [], 0.0, 0
    count = int(tracks.max(initial=-1)) + 1
    for first in range(0, max(count, 1), TRACKS):
        start, stop = np.searchsorted(tracks, [first, first + TRACKS])
        own, seen = tracks[start:stop] - first, image[start:stop]
        found = triangulate(pixels[start:stop], seen, own, poses, list(cameras))
        largest = np.zeros(len(found.points))
        np.maximum.at(largest, own, unit[seen])
        variance = np.bincount(own, unit[seen] ** 2) / np.bincount(own)
        kept = found.valid & (found.errors_px < ERROR_PX * largest) & (found.angles_deg > LEAST_ANGLE_DEG)
        parts.append((found.points, found.covariances * variance[:, None, None], kept))
        squared += float((found.squared_px / variance)[kept].sum())
        freedom += int((2 * np.bincount(own) - 3)[kept].sum())
    points, covariances, kept = (np.concatenate(each) for each in zip(*parts, strict=True))
    return points, covariances, kept, max(LEAST_VARIANCE, squared / max(1, freedom))
