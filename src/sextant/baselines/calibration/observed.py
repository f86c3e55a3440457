r"""The camera that a predicted field or predicted rays belong to, with its standard errors.

With :math:`x` = tilt, roll, vertical field of view v and :math:`\hat k_1 = k_1 / f^2`, the camera minimises

.. math:: \tfrac12 \sum_i \rho\!\left(\frac{o_i - o(x; p_i)}{\sigma_i}\right) ,
          \qquad \rho(e) = 2 (\sqrt{1 + e^2} - 1) ,

over the observations :math:`o_i` at image points :math:`p_i`: latitudes and up directions, or rays. The minimum is
found by Levenberg-Marquardt steps from several fields of view. Its covariance is the inverse curvature. Errors of
neighbouring points are alike, so all of them together count as :data:`INDEPENDENT` points; where the observations
contradict each other by more than their spreads allow, it is larger by their mean squared residual.

Sources: L. Jin et al., "Perspective Fields for single image camera calibration", CVPR 2023; A. Veicht et al.,
"GeoCalib: learning single-image calibration with geometric optimization", ECCV 2024; J. Tirado-Garin and J. Civera,
"AnyCalib: on-manifold learning for model-agnostic single-view camera calibration", ICCV 2025.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Float, Float64
from numpy import ndarray
from torch import Tensor

from sextant.baselines.calibration.terms import CameraBelief
from sextant.errors import ArgumentError
from sextant.geometry import CameraParameters, focal_from_vfov, k2_of_k1
from sextant.geometry.perspective import perspective_bearings
from sextant.geometry.perspective_field import PerspectiveField, field_errors, perspective_field

#: independent points that a whole field is worth: that of Sextant's own network, 49 cells, each worth
#: :data:`sextant.geometry.field_fit.EVIDENCE` of one
INDEPENDENT = 0.15 * 49
#: fields of view (degrees) and k1_hat that are compared first; the search starts from the best few. From one start, it
#: ends in the wrong minimum for one in a hundred lenses
VFOVS, K1_HATS, STARTS = (12, 20, 30, 40, 50, 60, 70, 80, 90, 105, 120), (-1.5, -0.8, -0.4, -0.15, 0.0, 0.15), 3
#: ends of the search: tilt, roll, vfov (radians) and k1_hat
LOWEST = np.array([-1.55, -math.pi, math.radians(4), -2.0])
HIGHEST = np.array([1.55, math.pi, math.radians(170), 2.0])
STEPS, DIFFERENCE, SMALLEST_STEP = 60, 1e-5, 1e-9
#: spread of observations without one, which bounds the influence of wrong ones; the errors are then measured
USUAL_SPREAD = math.radians(1)
#: least standard error, so that observations without errors are no division by zero
LEAST = 1e-6
#: the most points used, since neighbours hardly add evidence; of more, these are drawn (even steps along the rows of a
#: map can fall on a diagonal of it)
MOST = 1024
#: the fewest points
FEWEST = 4


class Observed(ABC):
    """What a network says about the points of a photo."""

    points: Float[ndarray, "n 2"]
    #: which of tilt, roll, vfov and k1_hat it determines
    numbers: ClassVar[tuple[int, ...]]
    #: whether k1_hat is fitted; otherwise it is taken as 0, and not known
    distortion: bool

    @abstractmethod
    def residuals(self, vectors: Float64[ndarray, "b 4"]) -> Float64[ndarray, "b m"]:
        """Observations minus those of cameras, in their spreads."""

    @abstractmethod
    def start(self) -> tuple[float, float]:
        """Tilt and roll to start from."""

    @property
    def count(self) -> int:
        """Number of points."""
        return len(self.points)

    #: whether the spreads are given; otherwise the errors are measured by the residuals
    has_spread: bool = True

    @property
    def free(self) -> tuple[int, ...]:
        """The numbers that are fitted."""
        return self.numbers if self.distortion else self.numbers[:-1]

    def belief(self) -> CameraBelief:
        """The camera with standard errors; infinite for numbers that are not determined or at an end of the search.

        Raises:
            ArithmeticError: no camera fits, or the observations determine none.
        """
        vector, cost, slope = min(map(self._fitted, self._starts()), key=lambda each: each[1])
        if not math.isfinite(cost):
            raise ArithmeticError("no camera fits what the network says")
        sigma = np.full(4, np.inf)
        sigma[list(self.free)] = self._sigmas(slope, cost)
        sigma[(vector <= LOWEST) | (vector >= HIGHEST)] = np.inf
        tilt, roll, vfov, k1_hat = map(float, vector)
        focal = float(focal_from_vfov(torch.tensor(vfov, dtype=torch.float64)))
        first, second, third, fourth = map(float, np.maximum(sigma, LEAST))
        return CameraBelief(tilt, roll, focal, k1_hat, (first, second, third, fourth))

    def _sigmas(self, slope: Float64[ndarray, "m k"], cost: float) -> Float64[ndarray, "k"]:
        spread = 2 * cost / max(2 * self.count - len(self.free), 1)  # a point has two numbers, whether field or ray
        if self.has_spread:
            spread = max(spread, 1.0)
        weight = min(INDEPENDENT / self.count, 1.0)
        values, axes = np.linalg.eigh(slope.T @ slope)
        if values[0] <= 1e-12 * values[-1]:
            raise ArithmeticError("what the network says does not determine a camera")
        return np.asarray(np.sqrt(np.square(axes) @ (1 / values) * spread / weight))

    def _starts(self) -> Float64[ndarray, "k 4"]:
        """The cameras of least cost among a grid of lenses."""
        k1_hats = K1_HATS if self.distortion else (0.0,)
        lenses = np.array([[*self.start(), math.radians(vfov), k1_hat] for vfov in VFOVS for k1_hat in k1_hats])
        costs = np.square(_rooted(self.residuals(lenses))).sum(axis=1)
        return lenses[np.argsort(np.nan_to_num(costs, nan=np.inf), kind="stable")[:STARTS]]

    def _fitted(self, at: Float64[ndarray, "4"]) -> tuple[Float64[ndarray, "4"], float, Float64[ndarray, "m k"]]:
        """The nearest minimum, its cost and the slopes of the rooted residuals there."""
        free, damping = list(self.free), 1e-3
        residuals, slope = self._linear(at)
        cost = 0.5 * float(residuals @ residuals)
        for _ in range(STEPS):
            curvature = slope.T @ slope
            if not curvature.any():  # no number matters to these points
                break
            scale = np.diag(curvature).max() * 1e-12 + np.diag(curvature)
            step = np.linalg.solve(curvature + damping * np.diag(scale), slope.T @ residuals)
            tried = at.copy()
            tried[free] = np.clip(at[free] - step, LOWEST[free], HIGHEST[free])
            new = _rooted(self.residuals(tried[None])[0])
            new_cost = 0.5 * float(new @ new)
            if not new_cost < cost:
                damping *= 10
                if np.abs(step).max() < SMALLEST_STEP:
                    break
                continue
            moved = float(np.abs(tried - at).max())
            at, cost, damping = tried, new_cost, max(damping / 10, 1e-12)
            residuals, slope = self._linear(at)
            if moved < SMALLEST_STEP:
                break
        return at, cost, slope

    def _linear(self, at: Float64[ndarray, "4"]) -> tuple[Float64[ndarray, "m"], Float64[ndarray, "m k"]]:
        """The rooted residuals and their slopes along the free numbers."""
        apart = DIFFERENCE * np.eye(4)[list(self.free)]
        rooted = _rooted(self.residuals(np.concatenate([at[None], at + apart, at - apart])))
        k = len(self.free)
        return rooted[0], (rooted[1 : k + 1] - rooted[k + 1 :]).T / (2 * DIFFERENCE)


def _rooted(errors: Float64[ndarray, "*b m"]) -> Float64[ndarray, "*b m"]:
    """Roots of the loss, with the sign of the errors."""
    return np.asarray(errors / np.sqrt(0.5 * (np.sqrt(1 + np.square(errors)) + 1)))


@dataclass(frozen=True, eq=False)
class ObservedField(Observed):
    """Latitudes and up directions at points of a photo, with their spreads.

    Attributes:
        points: image points, in heights of the photo from its centre, x to the right and y down.
        latitude: radians above the horizon.
        up: directions in the image in which a point moves when its scene point is lifted; any length.
        latitude_sigma, up_sigma: standard errors in radians.
        distortion: false for a network that was trained on pictures without distortion, and cannot tell it.

    Raises:
        ArgumentError: a shape does not fit, a value is not finite, or a spread is not above 0.

    Example:
        >>> camera = CameraParameters(*torch.tensor([0.2, -0.1, 0.9, -0.05], dtype=torch.float64))
        >>> points = map_points(12, 16, 4 / 3)
        >>> field = perspective_field(camera, torch.from_numpy(points))
        >>> sure = np.full(len(points), 0.01)
        >>> found = ObservedField(points, field.latitude.numpy(), field.up.numpy(), sure, sure).belief()
        >>> [round(value, 6) + 0.0 for value in (found.tilt, found.roll, found.focal, found.k1_hat * found.focal**2)]
        [0.2, -0.1, 0.9, -0.05]
    """

    points: Float[ndarray, "n 2"]
    latitude: Float[ndarray, "n"]
    up: Float[ndarray, "n 2"]
    latitude_sigma: Float[ndarray, "n"]
    up_sigma: Float[ndarray, "n"]
    distortion: bool = True
    numbers = (0, 1, 2, 3)

    def __post_init__(self) -> None:
        _settle(self, {"points": 2, "latitude": 0, "up": 2, "latitude_sigma": 0, "up_sigma": 0})
        if not np.linalg.norm(self.up, axis=1).all():
            raise ArgumentError("an observed field's up directions must not be 0", "Leave such points out.")

    def start(self) -> tuple[float, float]:
        """Latitude and up direction of the points about the centre, where they are tilt and roll."""
        near = np.argsort(np.linalg.norm(self.points, axis=1), kind="stable")[: max(4, self.count // 20)]
        up = self.up[near].mean(0)
        return float(np.clip(np.median(self.latitude[near]), -1.5, 1.5)), float(math.atan2(-up[0], -up[1]))

    def residuals(self, vectors: Float64[ndarray, "b 4"]) -> Float64[ndarray, "b m"]:
        """Differences of latitudes, and angles between up directions."""
        field = perspective_field(_cameras(vectors), torch.from_numpy(self.points))
        said = PerspectiveField(torch.from_numpy(self.latitude), torch.from_numpy(self.up))
        errors = field_errors(field, said).numpy()
        return np.asarray((errors / [self.latitude_sigma, self.up_sigma]).reshape(len(vectors), -1))


@dataclass(frozen=True, eq=False)
class ObservedRays(Observed):
    """Viewing rays at points of a photo: its lens, whatever its pose.

    Attributes:
        points: image points, in heights of the photo from its centre, x to the right and y down.
        rays: directions in the camera frame: right, down and forward; any length.
        sigma: standard errors in radians; None if the network gives none, and the scatter is measured.
        distortion: as for :class:`ObservedField`.

    Raises:
        ArgumentError: a shape does not fit, a value is not finite, or a spread is not above 0.

    Example:
        >>> points = map_points(12, 16, 4 / 3)
        >>> found = ObservedRays(points, np.column_stack([points, np.full(len(points), 0.8)])).belief()
        >>> round(found.focal, 6), found.sigma[0]  # the pose is not known
        (0.8, inf)
    """

    points: Float[ndarray, "n 2"]
    rays: Float[ndarray, "n 3"]
    sigma: Float[ndarray, "n"] | None = None
    distortion: bool = True
    numbers = (2, 3)

    def __post_init__(self) -> None:
        object.__setattr__(self, "has_spread", self.sigma is not None)
        if self.sigma is None:
            object.__setattr__(self, "sigma", np.full(len(self.points), USUAL_SPREAD))
        _settle(self, {"points": 2, "rays": 3, "sigma": 0})
        lengths = np.linalg.norm(self.rays, axis=1, keepdims=True)
        if not lengths.all():
            raise ArgumentError("observed rays must not be 0", "Leave such points out.")
        object.__setattr__(self, "rays", self.rays / lengths)

    def start(self) -> tuple[float, float]:
        """Level: rays do not depend on the pose."""
        return 0.0, 0.0

    def residuals(self, vectors: Float64[ndarray, "b 4"]) -> Float64[ndarray, "b m"]:
        """Differences of unit rays."""
        camera = _cameras(vectors)
        k1 = camera.k1[..., None]
        rays = perspective_bearings(torch.from_numpy(self.points), camera.focal[..., None], k1, k2_of_k1(k1))
        assert self.sigma is not None
        return np.asarray(((rays.numpy() - self.rays) / self.sigma[:, None]).reshape(len(vectors), -1))


def map_points(rows: int, columns: int, aspect: float, height: float = 1.0) -> Float64[ndarray, "n 2"]:
    """Centres of the cells of a map over the middle of a photo, row by row, in heights of the photo from its centre.

    Args:
        rows, columns: of the map.
        aspect: width over height of the part that the map covers.
        height: of that part, in heights of the photo.

    >>> map_points(1, 2, 2.0)
    array([[-0.5,  0. ],
           [ 0.5,  0. ]])
    """
    down, across = ((np.arange(n) + 0.5) / n - 0.5 for n in (rows, columns))
    grid = np.meshgrid(across * aspect * height, down * height)
    return np.column_stack([each.ravel() for each in grid])


def _cameras(vectors: Float64[ndarray, "b 4"]) -> CameraParameters:
    tilt, roll, vfov, k1_hat = (each[:, None] for each in torch.from_numpy(vectors).unbind(-1))
    focal: Tensor = focal_from_vfov(vfov)
    camera = CameraParameters(tilt, roll, focal, k1_hat * focal.square())
    return CameraParameters(*(each.squeeze(-1) for each in camera))


def _settle(observed: Observed, axes: dict[str, int]) -> None:
    """Check arrays and keep them in double precision, at most :data:`MOST` points of them."""
    kind = type(observed).__name__
    count = len(observed.points) if hasattr(observed.points, "__len__") else 0
    if count < FEWEST:
        raise ArgumentError(f"{kind}: {count} points; at least {FEWEST} are needed", "Give more points.")
    keep = np.arange(count)
    if count > MOST:
        keep = np.sort(np.random.default_rng(0).choice(count, MOST, replace=False))
    for name, axis in axes.items():
        values = np.array(getattr(observed, name), np.float64)
        wanted = (count, axis) if axis else (count,)
        if values.shape != wanted:
            raise ArgumentError(
                f"{kind}: {name} has the shape {values.shape}, and {wanted} is expected",
                "Give one row for each point.",
            )
        if not np.isfinite(values).all() or (name.endswith("sigma") and not (values > 0).all()):
            rule = "finite and above 0" if name.endswith("sigma") else "finite"
            raise ArgumentError(f"{kind}: {name} must be {rule}", "Leave out points that are not known.")
        object.__setattr__(observed, name, np.ascontiguousarray(values[keep]))
