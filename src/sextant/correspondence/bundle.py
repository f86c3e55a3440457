r"""Bundle adjustment of a few photos of one camera whose focal length is unknown.

Unknown are the poses, the points and what the photos share: the logarithm of the focal length f, one coefficient k of
radial distortion, and the principal point's offset c from the centre, of each orientation of the photos. The error of a
pixel p, from the centre, of the point :math:`X = (X_1, X_2, X_3)` in the axes of its camera is

.. math:: r = \frac{(p - c)(1 + k s) - f (X_1, X_2) / X_3}{1 + 2 k s} , \qquad s = \frac{|p - c|^2}{L^2} ,

with the longer side L; the denominator is by how much lengths near p grow to first order, without which a negative k
would shrink all errors. Minimised is the deviation
:math:`\sum \rho(r) / s^2 + |c|^2 / s_c^2 + k^2 / s_k^2`, whose priors stand for cameras in general, with errors that
are bounded, :math:`\rho(r) = |r|^2 / (1 + |r|^2 / T^2)` (Geman and McClure), so that wrong matches have no say. By
Gauss-Newton with damping; the points are eliminated from the normal equations (Triggs et al. 1999).
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy.spatial.transform import Rotation

from sextant.correspondence.pinhole import cross_matrices

#: T: errors of a right match stay below it, in pixels of the pictures that features were detected in
LARGEST_PX = 2.0
#: standard deviations of the priors of distortion (1 % at the corners) and principal point (in longer sides): the known
#: cameras of the real sets have principal points 0.8 (EPFL), 1.9 (York) and 3.6 % (a webcam) off the centre
DISTORTION, PRINCIPAL_POINT = 0.025, 0.015
ITERATIONS = 40
#: decrease of the deviation at which a fit ends
SMALL = 0.02
#: depth of a point that counts as behind its camera, in units of the first baseline
BEHIND = 1e-6


@dataclass(frozen=True, eq=False)
class Tracks:
    """Pixels of points, sorted by point.

    Attributes:
        pixels: from the centre of their photo.
        photos, points: their numbers.
        orientations: of each photo, 0 or 1, each with its principal point.
        side: longer side of the photos.
        largest_px: T.
    """

    pixels: Float64[ndarray, "m 2"]
    photos: Int64[ndarray, "m"]
    points: Int64[ndarray, "m"]
    orientations: Int64[ndarray, "n"]
    side: float
    largest_px: float = LARGEST_PX

    def only(self, points: Bool[ndarray, "p"]) -> "Tracks":
        """The pixels of some points, which are numbered anew."""
        rows = points[self.points]
        number = np.cumsum(points) - 1
        return replace(self, pixels=self.pixels[rows], photos=self.photos[rows], points=number[self.points[rows]])


@dataclass(frozen=True, eq=False)
class Scene:
    """Values of the unknowns.

    Attributes:
        shared: log f, k, and one principal point for each orientation.
        rotations, translations: camera from world, of each photo.
        points: of the world.
    """

    shared: Float64[ndarray, "s"]
    rotations: Float64[ndarray, "n 3 3"]
    translations: Float64[ndarray, "n 3"]
    points: Float64[ndarray, "p 3"]

    def moved(self, change: Float64[ndarray, "s_6n"], points: Float64[ndarray, "p 3"]) -> "Scene":
        """After a change of what is shared and of the poses, and one of the points."""
        poses = change[len(self.shared) :].reshape(-1, 6)
        turns = Rotation.from_rotvec(poses[:, :3]).as_matrix()
        return Scene(
            self.shared + change[: len(self.shared)],
            turns @ self.rotations,
            self.translations + poses[:, 3:],
            self.points + points,
        )


@dataclass(frozen=True, eq=False)
class Fit:
    """A minimum.

    Attributes:
        scene: the unknowns there.
        deviation: at the minimum.
        log_sigma: standard deviation of log f by the curvature there.
        slope: of the unknowns by log f along the valley of the deviation.
    """

    scene: Scene
    deviation: float
    log_sigma: float
    slope: tuple[Float64[ndarray, "s_6n"], Float64[ndarray, "p 3"]]

    @property
    def log_focal(self) -> float:
        """Logarithm of the focal length."""
        return float(self.scene.shared[0])

    def towards(self, log_focal: float) -> Scene:
        """Where to start at another focal length."""
        by = log_focal - self.log_focal
        return self.scene.moved(by * self.slope[0], by * self.slope[1])


def errors(tracks: Tracks, scene: Scene) -> Float64[ndarray, "m 2"]:
    """The errors of the module's equation; far above T behind a camera."""
    offset, straight, square = _straight(tracks, scene)
    turned = np.einsum("mij,mj->mi", scene.rotations[tracks.photos], scene.points[tracks.points])
    inside = turned + scene.translations[tracks.photos]
    depth = inside[:, 2:]
    found = straight - np.exp(scene.shared[0]) * inside[:, :2] / np.where(depth > BEHIND, depth, 1.0)
    return np.where(depth > BEHIND, found / _growth(scene, square), 1e3 + 0 * offset)


def variance_of(tracks: Tracks, scene: Scene) -> float:
    """Variance of a coordinate of a right pixel, by the median of the errors and their degrees of freedom."""
    squared = (errors(tracks, scene) ** 2).sum(1)
    right = squared < tracks.largest_px**2
    known, unknown = 2 * right.sum(), 3 * len(np.unique(tracks.points[right])) + 6 * len(scene.translations)
    freedom = max(known - unknown, known / 8) / known
    return float(np.median(squared[right]) / (1.386 * freedom))  # the median of chi2_2


def fitted(tracks: Tracks, scene: Scene, variance: float, free: bool) -> Fit:
    """The minimum near a start.

    Args:
        tracks: what is seen.
        scene: the start; the first photo keeps its pose, and the second the largest number of its translation.
        variance: of a coordinate of a pixel, with its overdispersion.
        free: whether the focal length is fitted as well.
    """
    precision, loose = _precision(tracks, scene), _loose(scene, free)
    damping, deviation = 1e-4, _deviation(tracks, scene, variance, precision)
    for _ in range(ITERATIONS):
        normal = _eliminated(tracks, scene, variance, precision, damping)
        change = np.zeros(len(normal.gradient))
        change[loose] = -_solved(normal.hessian[np.ix_(loose, loose)], normal.gradient[loose], damping)
        change[0] = np.clip(change[0], -0.3, 0.3)
        moved = scene.moved(change, normal.points(change))
        lower = _deviation(tracks, moved, variance, precision)
        if not lower <= deviation:
            damping *= 10
            if damping > 1e4:
                break
            continue
        gained, deviation, scene, damping = deviation - lower, lower, moved, max(damping / 10, 1e-9)
        if gained < SMALL:
            break
    normal = _eliminated(tracks, scene, variance, precision, 1e-9)
    loose = _loose(scene, free=False)
    slope = np.zeros(len(normal.gradient))
    slope[0] = 1.0
    slope[loose] = -_solved(normal.hessian[np.ix_(loose, loose)], normal.hessian[loose, 0], 0.0)
    curvature = max(float(normal.hessian[0] @ slope), 1e-12)
    return Fit(scene, deviation, curvature**-0.5, (slope, normal.slopes(slope)))


class _Normal(NamedTuple):
    """Normal equations without the points."""

    hessian: ndarray
    gradient: ndarray
    inverse: ndarray
    mixed: ndarray
    own: ndarray

    def points(self, change: ndarray) -> ndarray:
        """The change of the points that goes with a change of the rest."""
        return np.asarray(-np.einsum("pij,pj->pi", self.inverse, self.own + self._through(change)))

    def slopes(self, slope: ndarray) -> ndarray:
        """The slopes of the points that go with slopes of the rest."""
        return np.asarray(-np.einsum("pij,pj->pi", self.inverse, self._through(slope)))

    def _through(self, change: ndarray) -> ndarray:
        return np.asarray(np.einsum("psi,s->pi", self.mixed, change))


def _straight(tracks: Tracks, scene: Scene) -> tuple[ndarray, ndarray, ndarray]:
    """Offsets from the principal point, those without distortion, and their squares over that of the side."""
    offset = tracks.pixels - scene.shared[2:].reshape(-1, 2)[tracks.orientations[tracks.photos]]
    square = (offset**2).sum(1, keepdims=True) / tracks.side**2
    return offset, offset * (1 + scene.shared[1] * square), square


def _growth(scene: Scene, square: ndarray) -> ndarray:
    """By how much lengths near a pixel grow without distortion, to first order; bounded for steps that go astray."""
    return np.asarray(np.maximum(1 + 2 * scene.shared[1] * square, 0.1))


def _eliminated(tracks: Tracks, scene: Scene, variance: float, precision: ndarray, damping: float) -> _Normal:
    found = errors(tracks, scene)
    weight = (1 + (found**2).sum(1) / tracks.largest_px**2) ** -2 / variance
    ours, theirs = _slopes(tracks, scene, found)
    starts = np.flatnonzero(np.diff(tracks.points, prepend=-1))
    weighted = theirs * weight[:, None, None]
    square = np.add.reduceat(np.einsum("mki,mkj->mij", weighted, theirs), starts)
    mixed = np.add.reduceat(ours.transpose(0, 2, 1) @ weighted, starts)
    own = np.add.reduceat(np.einsum("mki,mk->mi", weighted, found), starts)
    diagonal = np.einsum("pii->pi", square)
    inverse = np.linalg.inv(
        square + np.einsum("pi,ij->pij", damping * diagonal + 1e-9 * diagonal.max() + 1e-12, np.eye(3))
    )
    flat = ours.reshape(-1, ours.shape[2])
    twice = np.repeat(weight, 2)[:, None]
    through = np.einsum("psi,pij->psj", mixed, inverse).transpose(1, 0, 2).reshape(len(precision), -1)
    mixed_flat = mixed.transpose(1, 0, 2).reshape(len(precision), -1)
    values = np.concatenate([scene.shared, np.zeros(len(precision) - len(scene.shared))])
    hessian = (flat * twice).T @ flat - through @ mixed_flat.T + np.diag(precision)
    gradient = (flat * twice).T @ found.ravel() - through @ own.ravel() + precision * values
    return _Normal(hessian, gradient, inverse, mixed, own)


def _slopes(tracks: Tracks, scene: Scene, found: ndarray) -> tuple[ndarray, ndarray]:
    """Derivatives of the errors ``found`` by what is shared and the poses, and by the points."""
    count, shared, focal = len(tracks.pixels), len(scene.shared), np.exp(scene.shared[0])
    offset, _, square = _straight(tracks, scene)
    turned = np.einsum("mij,mj->mi", scene.rotations[tracks.photos], scene.points[tracks.points])
    x, y, z = (turned + scene.translations[tracks.photos]).T
    z = np.where(z > BEHIND, z, np.inf)  # a point behind its camera is not moved by it
    zero = np.zeros_like(x)
    growth = _growth(scene, square)[:, :, None]
    inside = (
        -focal / growth * np.stack([np.stack([1 / z, zero, -x / z**2], 1), np.stack([zero, 1 / z, -y / z**2], 1)], 1)
    )
    ours = np.zeros((count, 2, shared + 6 * len(scene.translations)))
    rows = np.arange(count)
    ours[:, :, 0] = -focal * np.column_stack([x / z, y / z]) / growth[:, :, 0]
    ours[:, :, 1] = (offset - 2 * found) * square / growth[:, :, 0]
    principal = -(1 + scene.shared[1] * square)[:, :, None] * np.eye(2)
    principal -= 2 * scene.shared[1] / tracks.side**2 * np.einsum("mi,mj->mij", offset - 2 * found, offset)
    principal /= growth
    at = 2 + 2 * tracks.orientations[tracks.photos]
    pose = shared + 6 * tracks.photos
    for k in range(2):
        ours[rows, :, at + k] = principal[:, :, k]
    by_pose = np.concatenate([-inside @ cross_matrices(turned), inside], 2)
    for k in range(6):
        ours[rows, :, pose + k] = by_pose[:, :, k]
    return ours, inside @ scene.rotations[tracks.photos]


def _solved(matrix: ndarray, side: ndarray, damping: float) -> ndarray:
    """The solution of damped normal equations; a photo all whose pixels are wrong stays where it is."""
    diagonal = np.diag(matrix)
    return np.linalg.solve(matrix + np.diag(damping * diagonal + 1e-12 * diagonal.max()), side)


def _precision(tracks: Tracks, scene: Scene) -> Float64[ndarray, "s_6n"]:
    found = np.zeros(len(scene.shared) + 6 * len(scene.translations))
    found[1] = DISTORTION**-2
    found[2 : len(scene.shared)] = (tracks.side * PRINCIPAL_POINT) ** -2
    return found


def _loose(scene: Scene, free: bool) -> Int64[ndarray, "_"]:
    """Numbers of the unknowns that are fitted: neither position nor scale of the world is determined."""
    start, fixed = len(scene.shared), np.zeros(len(scene.shared) + 6 * len(scene.translations), bool)
    fixed[0] = not free
    fixed[start : start + 6] = True
    fixed[start + 9 + int(np.abs(scene.translations[1]).argmax())] = True
    return np.flatnonzero(~fixed)


def _deviation(tracks: Tracks, scene: Scene, variance: float, precision: ndarray) -> float:
    prior = float((precision[: len(scene.shared)] * scene.shared**2).sum())
    squared = (errors(tracks, scene) ** 2).sum(1)
    return float((squared / (1 + squared / tracks.largest_px**2)).sum()) / variance + prior
