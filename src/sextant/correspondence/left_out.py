r"""How much larger the errors of poses in a map are than their covariances say, from the map itself.

The covariance of a pose knows the noise of pixels and points. It does not know that points seen in one image share
the errors of that image's pose and lens, so that they do not average out. Each of some images is therefore located by
points of the other images, as a photo would be, and compared with the pose that it was given. Its error :math:`e_i`,
with the covariance :math:`\Sigma_i` of pixels and points, is taken to be of Student's distribution with the scale

.. math:: C_i = s \, (c \Sigma_i + \mathrm{diag}(d^2, d^2, d^2, r^2, r^2, r^2)),

in which c, d and r are the likeliest, c at least 1: displacements and rotations of the map's images have not the shape
of :math:`\Sigma_i`. The factor s makes the median right,

.. math:: s = \frac{\mathrm{median}_i \, e_i^\top C_i^{-1} e_i}{5.348} \cdot \frac{\nu}{\nu - 2},
          \qquad \nu = 3.48 \, n,

where 5.348 is the median of :math:`\chi^2_6`, and the second factor is for the uncertainty of a median of n values.
Covariances are never made smaller. The variance of a focal length is multiplied by the factor that s would be for
:math:`C_i = \Sigma_i`.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from sextant.correspondence.absolute_pose import EstimatedPose
from sextant.correspondence.posed_map import LEAST_ANGLE_DEG, PosedMap, PoseErrors
from sextant.correspondence.triangulation import triangulate

#: images that are left out, spread over the map, and those of which a factor is estimated at least
MOST, LEAST = 30, 5
#: degrees of freedom of Student's distribution: images that are located wrongly are far off, and have little say
TAIL = 4.0
#: logarithms of d and r, in standard deviations by pixels and points, from which the likeliest are sought, and the most
STARTS, BOUND = (-4.0, 0.0, 2.0, 4.0), 9.0
#: images that a left-out image is matched to
CANDIDATES = 10
#: degrees of freedom of a scaled chi-square distribution as variable as the median of n values of chi2_6, over n:
#: 2 / (relative standard deviation of the median)^2 = 2 (2 m f(m))^2 with its density f at its median m
_MEDIAN = float(chi2.median(6))
FREEDOM = 2 * (2 * _MEDIAN * float(chi2.pdf(_MEDIAN, 6))) ** 2


def calibrated(posed: PosedMap) -> PosedMap:
    """The map with the errors of its poses; none where fewer than five of its images are found by the others."""
    errors, covariances = [], []
    for image in np.unique(np.linspace(0, len(posed.features) - 1, MOST).round().astype(int)).tolist():
        rest, candidates = without(posed, image)
        found = rest.locate(posed.features[image], candidates, posed.cameras[image]).pose
        if found is not None:
            errors.append(displacement(found.world_from_camera, posed.poses[image]))
            covariances.append(found.covariance)
    if len(errors) < LEAST:
        return replace(posed, errors=PoseErrors())
    return replace(posed, errors=pose_errors(np.stack(errors), np.stack(covariances)))


def pose_errors(errors: Float64[ndarray, "n 6"], covariances: Float64[ndarray, "n 6 6"]) -> PoseErrors:
    """The errors of a map's poses from those of its images that were left out; see above.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> errors = rng.normal(size=(30, 6)) * [0.1, 0.1, 0.1, 0, 0, 0]
        >>> found = pose_errors(errors, np.tile(1e-6 * np.eye(6), (30, 1, 1)))
        >>> 0.08 < found.displacement < 0.13, found.rotation < 1e-3
        (True, True)
    """
    unit = np.sqrt([np.median(np.einsum("nkk->n", covariances[:, k : k + 3, k : k + 3]) / 3) for k in (0, 3)])

    def of(x: ndarray) -> PoseErrors:
        scale, displacement, rotation = np.exp(x)
        return PoseErrors(float(scale), float(displacement * unit[0]), float(rotation * unit[1]))

    def unlikeliness(x: ndarray) -> float:
        wider = of(x).of(covariances)
        squared = _squared(errors, wider)
        return float((np.linalg.slogdet(wider)[1] + (TAIL + 6) * np.log1p(squared / TAIL)).sum())

    starts = [np.array([0.0, *rest]) for rest in product(STARTS, STARTS)]
    bounds = [(0.0, None), (-BOUND, BOUND), (-BOUND, BOUND)]
    likeliest = of(minimize(unlikeliness, min(starts, key=unlikeliness), method="L-BFGS-B", bounds=bounds).x)
    wider = _factor(_squared(errors, likeliest.of(covariances)))
    return PoseErrors(
        likeliest.scale * wider,
        likeliest.displacement * wider**0.5,
        likeliest.rotation * wider**0.5,
        _factor(_squared(errors, covariances)),
    )


def _squared(errors: ndarray, covariances: ndarray) -> Float64[ndarray, "n"]:
    return np.asarray((errors * np.linalg.solve(covariances, errors[..., None])[..., 0]).sum(1))


def _factor(squared: Float64[ndarray, "n"]) -> float:
    """What makes the median of squared errors by their covariances that of their distribution; at least 1."""
    freedom = FREEDOM * len(squared)
    return max(1.0, float(np.median(squared)) / _MEDIAN * freedom / (freedom - 2))


def squared_error(found: EstimatedPose, pose: Float64[ndarray, "4 4"]) -> float:
    r"""The squared error of a pose by its covariance, :math:`e^\top \Sigma^{-1} e`."""
    error = displacement(found.world_from_camera, pose)
    return float(error @ np.linalg.solve(found.covariance, error))


def displacement(found: Float64[ndarray, "4 4"], pose: Float64[ndarray, "4 4"]) -> Float64[ndarray, "6"]:
    """What moves ``pose`` to ``found``: a displacement and a rotation vector in the axes of the camera.

    Example:
        >>> moved = np.eye(4)
        >>> moved[0, 3] = 0.5
        >>> displacement(moved, np.eye(4)).tolist()
        [0.5, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    between = np.linalg.inv(pose) @ found
    return np.concatenate([between[:3, 3], Rotation.from_matrix(between[:3, :3]).as_rotvec()])


def without(posed: PosedMap, image: int) -> tuple[PosedMap, Sequence[int]]:
    """The map with its points triangulated without an image, and the images that share most points with it."""
    own = posed.point_of[image]
    shared = np.zeros(len(posed.points), bool)
    shared[own[own >= 0]] = True
    common = np.array([np.count_nonzero(shared[each[each >= 0]]) for each in posed.point_of])
    common[image] = 0
    candidates = [int(k) for k in np.argsort(-common, kind="stable")[:CANDIDATES] if common[k]]
    others = np.flatnonzero(common).tolist()
    seen = [np.flatnonzero((posed.point_of[k] >= 0) & shared[posed.point_of[k]]) for k in others]
    numbers = np.concatenate([posed.point_of[k][rows] for k, rows in zip(others, seen, strict=True)] or [own[:0]])
    pixels = np.concatenate(
        [posed.features[k].points[rows] for k, rows in zip(others, seen, strict=True)] or [np.empty((0, 2))]
    )
    images = np.repeat(np.array(others, np.int64), [len(rows) for rows in seen])
    twice = np.bincount(numbers, minlength=len(posed.points)) >= 2
    kept = twice[numbers]
    ids, tracks = np.unique(numbers[kept], return_inverse=True)
    cameras = list(posed.cameras)
    found = triangulate(pixels[kept].astype(np.float64), images[kept], tracks, posed.poses, cameras)
    points, covariances = posed.points.copy(), posed.covariances.copy()
    unit = np.array([each.pixel for each in posed.features])[images[kept]]
    variance = np.bincount(tracks, unit**2) / np.bincount(tracks)
    points[ids] = found.points
    covariances[ids] = found.covariances * (posed.pixel_variance * variance)[:, None, None]
    valid = ~shared
    valid[ids] = found.valid & (found.angles_deg > LEAST_ANGLE_DEG)
    point_of = list(posed.point_of)
    for k in (*others, image):
        point_of[k] = np.where((point_of[k] >= 0) & valid[point_of[k]], point_of[k], -1)
    return replace(posed, points=points, covariances=covariances, point_of=point_of, errors=PoseErrors()), candidates
