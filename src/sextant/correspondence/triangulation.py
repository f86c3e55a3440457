r"""Points of the world from pixels of images at known poses.

A point minimises the squared reprojection errors of its track, from the linear solution by Gauss-Newton. Its
covariance is :math:`\sigma^2 (\sum_k J_k^\top J_k)^{-1}` with the pixels' standard deviation :math:`\sigma`.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy.sparse import csr_matrix

from sextant.correspondence.pinhole import Pinhole
from sextant.shapes import check_shape

#: steps of Gauss-Newton; the linear solution is near
STEPS = 5


@dataclass(frozen=True, eq=False)
class Triangulated:
    """Points of tracks.

    Attributes:
        points: in the world.
        covariances: for pixels of a standard deviation of 1.
        errors_px: largest reprojection error within each track.
        squared_px: sum of the squared reprojection errors of each track.
        angles_deg: largest angle between the first ray of each track and another.
        valid: of two pixels or more, and in front of all its cameras.
    """

    points: Float64[ndarray, "n 3"]
    covariances: Float64[ndarray, "n 3 3"]
    errors_px: Float64[ndarray, "n"]
    squared_px: Float64[ndarray, "n"]
    angles_deg: Float64[ndarray, "n"]
    valid: Bool[ndarray, "n"]


def triangulate(
    pixels: Float64[ndarray, "m 2"],
    images: Int64[ndarray, "m"],
    tracks: Int64[ndarray, "m"],
    poses: Float64[ndarray, "k 4 4"],
    cameras: list[Pinhole],
) -> Triangulated:
    """Triangulate tracks of pixels.

    Args:
        pixels: of the images.
        images: number of the image of each pixel.
        tracks: number of the track of each pixel, 0 to n - 1.
        poses: ``world_from_camera`` of each image.
        cameras: of each image.

    Returns:
        A track seen from one position only has angles of 0, and its depth is arbitrary.

    Raises:
        ArgumentError: the arrays have other shapes, or those of pixels or of images differ in number.

    Example:
        >>> camera, poses = Pinhole.centred(640, 480, 500.0), np.tile(np.eye(4), (2, 1, 1))
        >>> poses[1, 0, 3] = 1.0
        >>> pixels = np.array([[419.5, 239.5], [319.5, 239.5]])
        >>> found = triangulate(pixels, np.array([0, 1]), np.array([0, 0]), poses, [camera, camera])
        >>> found.points.round(6).tolist(), round(float(found.angles_deg[0]), 1)
        ([[1.0, 0.0, 5.0]], 11.3)
    """
    check_shape("pixels", pixels, "m", 2)
    check_shape("images", images, len(pixels))
    check_shape("tracks", tracks, len(pixels))
    check_shape("poses", poses, len(cameras), 4, 4)
    focal = np.array([(camera.fx, camera.fy) for camera in cameras])[images]
    centre = np.array([(camera.cx, camera.cy) for camera in cameras])[images]
    rotation, position = poses[images, :3, :3], poses[images, :3, 3]
    normalised = (pixels - centre) / focal
    count = int(tracks.max(initial=-1)) + 1
    directions = np.einsum("mij,mj->mi", rotation, np.column_stack([normalised, np.ones(len(pixels))]))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = _nearest_to_rays(directions, position, tracks, count)
    for _ in range(STEPS):
        error, jacobian, _ = _linearised(points, pixels, tracks, rotation, position, focal, centre)
        hessian = _summed(np.einsum("mki,mkj->mij", jacobian, jacobian), tracks, count)
        gradient = _summed(np.einsum("mki,mk->mi", jacobian, error), tracks, count)
        points = points - np.linalg.solve(_regular(hessian), gradient[..., None])[..., 0]
    error, jacobian, depth = _linearised(points, pixels, tracks, rotation, position, focal, centre)
    hessian = _summed(np.einsum("mki,mkj->mij", jacobian, jacobian), tracks, count)
    errors, behind = np.zeros(count), np.zeros(count, bool)
    np.maximum.at(errors, tracks, np.linalg.norm(error, axis=1))
    np.logical_or.at(behind, tracks, depth <= 0)
    finite = np.isfinite(points).all(1) & np.isfinite(errors)
    covariances = np.linalg.inv(_regular(np.where(finite[:, None, None], hessian, np.eye(3))))
    squared = np.bincount(tracks, (error**2).sum(1), minlength=count)
    valid = finite & ~behind & (np.bincount(tracks, minlength=count) >= 2)
    return Triangulated(points, covariances, errors, squared, _angles(directions, tracks, count), valid)


def _regular(hessians: ndarray) -> ndarray:
    """Hessians that have an inverse, also where all rays of a point are one and leave its depth open."""
    trace = np.trace(hessians, axis1=1, axis2=2)
    return np.asarray(hessians + (1e-12 * (1 + trace))[:, None, None] * np.eye(3))


def _nearest_to_rays(directions: ndarray, positions: ndarray, tracks: ndarray, count: int) -> ndarray:
    """The points with the least sum of squared distances from the rays."""
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    matrix = _summed(across, tracks, count)
    vector = _summed(np.einsum("mij,mj->mi", across, positions), tracks, count)
    return np.linalg.solve(matrix + 1e-9 * np.eye(3), vector[..., None])[..., 0]


def _linearised(
    points: ndarray,
    pixels: ndarray,
    tracks: ndarray,
    rotation: ndarray,
    position: ndarray,
    focal: ndarray,
    centre: ndarray,
) -> tuple[ndarray, ndarray, ndarray]:
    """Errors of the pixels, their derivatives by the points of the world, and the depths."""
    inside = np.einsum("mji,mj->mi", rotation, points[tracks] - position)
    x, y, z = inside.T
    safe = np.where(np.abs(z) < 1e-9, 1e-9, z)
    error = inside[:, :2] / safe[:, None] * focal + centre - pixels
    zero = np.zeros_like(safe)
    u = np.column_stack([focal[:, 0] / safe, zero, -focal[:, 0] * x / safe**2])
    v = np.column_stack([zero, focal[:, 1] / safe, -focal[:, 1] * y / safe**2])
    return error, np.stack([u, v], 1) @ rotation.transpose(0, 2, 1), z


def _summed(values: ndarray, tracks: ndarray, count: int) -> ndarray:
    chosen = csr_matrix((np.ones(len(tracks)), (tracks, np.arange(len(tracks)))), (count, len(tracks)))
    return np.asarray(chosen @ values.reshape(len(values), math.prod(values.shape[1:]))).reshape(
        count, *values.shape[1:]
    )


def _angles(directions: ndarray, tracks: ndarray, count: int) -> ndarray:
    """The largest angle between a ray and the first ray of its track, degrees."""
    first = np.zeros((count, 3))
    first[tracks[::-1]] = directions[::-1]
    cosine = np.einsum("mi,mi->m", directions, first[tracks]).clip(-1, 1)
    widest = np.zeros(count)
    np.maximum.at(widest, tracks, np.rad2deg(np.arccos(cosine)))
    return widest
