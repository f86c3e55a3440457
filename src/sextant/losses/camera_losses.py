"""Losses of cameras: the error of an estimated camera against the true one."""

import math
from abc import abstractmethod
from typing import Annotated, Literal

import torch
from annotated_types import Ge, Le
from jaxtyping import Bool, Float
from torch import Tensor, nn

from sextant.geometry import CameraParameters, Parameterization, ParameterSpace, perspective_bearings
from sextant.geometry.field_fit import BelievedField
from sextant.geometry.perspective_field import PerspectiveField, field_errors
from sextant.geometry.rotations import rotation_from_tilt_roll, up_in_camera
from sextant.ranges import Positive, checked
from sextant.shapes import check_shape


class CameraLoss(nn.Module):
    """A loss between predicted and true cameras in the numbers of one parameterization.

    Args:
        space: the parameterization and its ranges.
    """

    def __init__(self, space: ParameterSpace):
        super().__init__()
        self.space = space

    @abstractmethod
    def forward(
        self, predicted: Float[Tensor, "b 4"], truth: Float[Tensor, "b 4"], aspect: Float[Tensor, "b"]
    ) -> Float[Tensor, "b"]:
        """Loss of each image; ``aspect`` is width over height.

        Raises:
            ArgumentError: the shapes are not those of one batch, which would broadcast.
        """


def _check_batch(predicted: Tensor, truth: Tensor, aspect: Tensor) -> None:
    check_shape("aspect", aspect, "b", fix="Give width over height of each image.")
    for name, numbers in (("predicted", predicted), ("truth", truth)):
        check_shape(name, numbers, len(aspect), 4)


def at_least_single(*values: Tensor) -> tuple[Tensor, ...]:
    """Values in float32 or wider: a network's outputs in half precision are compared in single precision."""
    return tuple(value.to(torch.promote_types(value.dtype, torch.float32)) for value in values)


Units = Literal["raw", "range", "natural", "learned"]
Penalty = Literal["l2", "huber"]
RAW_HEIGHT_PX = 224.0
DEGREES = 180 / torch.pi
#: factor on the steps of log variances relative to those of weights, so that a few hundred steps suffice
PACE = 10.0
#: initial learned variance: that of a number uniform over its range
EVEN = 1 / 12
#: raw units per natural unit
RAW = {"focal": RAW_HEIGHT_PX, "k1": 1.0, "k1_hat": 1.0, "rho": RAW_HEIGHT_PX, "tau": RAW_HEIGHT_PX}


class ParameterLoss(CameraLoss):
    r"""Squared or Huber penalty on the errors of the four numbers.

    The losses differ in the scale :math:`s_a`: in ``raw`` units (degrees, and the focal length in pixels of an image
    224 high) the large numbers dominate the small ones; ``range`` divides by the width of each number's range;
    ``natural`` takes radians and image heights as they are.

    ``learned`` starts from ``range`` and learns a variance :math:`\sigma_a^2` of each number with the network, so that
    no weight is set by hand: :math:`\frac14 \sum_a \big(e^{-v_a} h(s_a(\hat a - a)) + v_a\big)` with :math:`v_a = \ln
    \sigma_a^2`, twice the negative log-likelihood of normal errors but for a constant. It can be negative.

    Source of the learned variances: A. Kendall, Y. Gal, R. Cipolla, "Multi-task learning using uncertainty to weigh
    losses for scene geometry and semantics", CVPR 2018, section 3.2.

    ``l2``: :math:`h(e) = e^2`. ``huber``: :math:`h(e) = \tfrac12 e^2` for :math:`|e| \le \delta`, else
    :math:`\delta(|e| - \tfrac12 \delta)`, twice over, so that it equals ``l2`` near 0.

    Args:
        space: the parameterization and its ranges.
        units: ``raw``, ``range``, ``natural`` or ``learned``.
        penalty: ``l2`` or ``huber``.
        delta: where Huber's penalty becomes linear, in these units.

    Raises:
        UserError: units or penalty are unknown, or ``delta`` is not positive.

    Example:
        >>> from sextant.geometry import Parameterization
        >>> low, high = torch.tensor([-1.0, -1.0, 1.0, -1.0]), torch.tensor([1.0, 1.0, 3.0, 1.0])
        >>> loss = ParameterLoss(ParameterSpace(Parameterization("direct"), low, high))
        >>> truth, tilted = torch.tensor([[0.0, 0.0, 2.0, 0.0]]), torch.tensor([[0.2, 0.0, 2.0, 0.0]])
        >>> loss(tilted, truth, torch.ones(1))  # off by a tenth of the range: 0.1² / 4
        tensor([0.0025])
    """

    scale: Tensor

    @checked
    def __init__(
        self, space: ParameterSpace, *, units: Units = "range", penalty: Penalty = "l2", delta: Positive = 1.0
    ):
        super().__init__(space)
        self.penalty, self.delta = penalty, delta
        self.paced: nn.Parameter | None = None
        if units == "learned":
            self.paced = nn.Parameter(torch.full((4,), math.log(EVEN) / PACE))
        if units in ("range", "learned"):
            scale = 1 / (space.high - space.low)
        elif units == "raw":
            scale = torch.tensor([RAW.get(name, DEGREES) for name in space.parameterization.names])
        else:
            scale = torch.ones(4)
        self.register_buffer("scale", scale.float(), persistent=False)

    def forward(
        self, predicted: Float[Tensor, "b 4"], truth: Float[Tensor, "b 4"], aspect: Float[Tensor, "b"]
    ) -> Float[Tensor, "b"]:
        """Mean penalty over the four numbers; ``aspect`` is not used."""
        _check_batch(predicted, truth, aspect)
        predicted, truth = at_least_single(predicted, truth)
        size = ((predicted - truth) * self.scale).abs()
        penalty = size.square()
        if self.penalty == "huber":
            penalty = torch.where(size <= self.delta, penalty, self.delta * (2 * size - self.delta))
        if self.paced is not None:
            penalty = torch.exp(-self.log_variance) * penalty + self.log_variance
        return penalty.mean(-1)

    @property
    def log_variance(self) -> Float[Tensor, "4"]:
        """The logarithms of the learned variances, in widths of the ranges squared; 0 unless they are learned."""
        return torch.zeros_like(self.scale) if self.paced is None else PACE * self.paced


Mode = Literal["joint", "disentangled", "harmonic"]
STEPS = 41  # of each range, for the harmonic weights
STILL = 1e-4  # radians, root mean square over the range


def bearing_grid(side: int, aspect: Float[Tensor, "*b"]) -> Float[Tensor, "*b n 2"]:
    """A regular grid of ``side`` x ``side`` points over images, in image heights from the centre, edges included."""
    line = torch.linspace(-0.5, 0.5, side, dtype=aspect.dtype, device=aspect.device)
    v, u = torch.meshgrid(line, line, indexing="ij")
    return torch.stack([u.flatten() * aspect[..., None], v.flatten().expand(*aspect.shape, -1)], -1)


def world_bearings(
    camera: CameraParameters, parameterization: Parameterization, grid: Float[Tensor, "*#b n 2"]
) -> Float[Tensor, "*b n 3"]:
    """Unit rays of image points in the gravity frame, ``R(tilt, roll) c``."""
    tilt, roll, focal, k1 = camera
    rays = perspective_bearings(grid, focal[..., None], k1[..., None], parameterization.k2(k1)[..., None])
    rotation = rotation_from_tilt_roll(tilt, roll)[..., None, :, :]  # (*b, 1, 3, 3)
    return (rotation * rays[..., None, :]).sum(-1)  # products and sums, since mixed precision would round a matmul


class BearingLoss(CameraLoss):
    r"""The bearing loss: how far the rays of image points turn when the predicted camera replaces the true one.

    In the gravity frame, an image point :math:`u_i` has the bearing :math:`p_i(\Omega) = R(\theta, \psi)\, c_i`, with
    c_i its unit ray in the camera frame. Over a regular grid of n points

    .. math:: L(\hat\Omega, \Omega) = \frac1n \sum_i \|p_i(\hat\Omega) - p_i(\Omega)\|^2 .

    This gives the four numbers one meaningful unit, but they can compensate for each other's errors. The *disentangled*
    loss prevents this: for each number a, only a is taken from the prediction and the other three from the ground
    truth, :math:`L^* = \sum_a w_a L_a`, with :math:`w_a = \frac14`. The *harmonic* one uses the weights :math:`w_a
    \propto 1/S_a`, with S_a the mean of L_a when a runs over its range, so that all four learn at the same pace.

    Source: M. Lopez-Antequera et al., "Deep single image camera calibration with radial distortion", CVPR 2019, section
    4; disentangling: A. Simonelli et al., "Disentangling monocular 3D object detection", ICCV 2019; weights: N. Wakai
    et al., "Rethinking generic camera models for deep single image camera calibration", ECCV 2022.

    Args:
        space: the parameterization and its ranges.
        mode: ``joint``, ``disentangled`` or ``harmonic``.
        grid: points along each side of the image.

    Raises:
        UserError: the mode is unknown or the grid has fewer than 2 points per side.

    Example:
        >>> cameras = torch.tensor([[0.0, 0.0, 100.0, 0.0], [0.1, 0.0, 100.0, 0.0]])  # f = 100 image heights
        >>> space = ParameterSpace(Parameterization("direct"), cameras[0] - 1, cameras[0] + 1)
        >>> BearingLoss(space, mode="joint")(cameras[1:], cameras[:1], torch.ones(1))  # raised by 0.1 rad: 0.1²
        tensor([0.0100])
    """

    weights: Tensor

    @checked
    def __init__(self, space: ParameterSpace, *, mode: Mode = "disentangled", grid: Annotated[int, Ge(2), Le(64)] = 7):
        super().__init__(space)
        self.mode, self.grid = mode, grid
        weights = harmonic_weights(space, grid) if mode == "harmonic" else torch.full((4,), 0.25)
        self.register_buffer("weights", weights.float(), persistent=False)

    def forward(
        self, predicted: Float[Tensor, "b 4"], truth: Float[Tensor, "b 4"], aspect: Float[Tensor, "b"]
    ) -> Float[Tensor, "b"]:
        """Mean squared bearing difference of each image."""
        _check_batch(predicted, truth, aspect)
        predicted, truth, aspect = at_least_single(predicted, truth, aspect)
        points = bearing_grid(self.grid, aspect)
        if self.mode == "joint":
            return bearing_difference(predicted, truth, self.space.parameterization, points)
        alone = one_at_a_time(predicted, truth, self.space.parameterization, points)
        return (alone * self.weights).sum(-1)


def bearing_difference(
    first: Float[Tensor, "*#b 4"],
    second: Float[Tensor, "*#b 4"],
    parameterization: Parameterization,
    grid: Float[Tensor, "*#b n 2"],
) -> Float[Tensor, "*b"]:
    """Mean over the grid of the squared distance between the bearings of two cameras."""
    p, q = (world_bearings(parameterization.decode(values), parameterization, grid) for values in (first, second))
    return (p - q).square().sum(-1).mean(-1)


def one_at_a_time(
    predicted: Float[Tensor, "b 4"],
    truth: Float[Tensor, "b 4"],
    parameterization: Parameterization,
    grid: Float[Tensor, "b n 2"],
) -> Float[Tensor, "b 4"]:
    """Bearing difference with one number predicted and the other three true, for each of the four.

    The replacement is in the numbers that the network predicts: a wrong vfov beside a true rho moves the tilt as well.
    """
    alone = torch.eye(4, dtype=torch.bool, device=truth.device)
    mixed = torch.where(alone, predicted[:, None], truth[:, None])  # (b, 4 replaced, 4 numbers)
    return bearing_difference(mixed, truth[:, None], parameterization, grid[:, None])


def harmonic_weights(space: ParameterSpace, grid: int = 7, aspect: float = 4 / 3) -> Float[Tensor, "4"]:
    """Weights proportional to ``1 / S_a`` that sum to 1, with S_a the mean of L_a as a runs over its range.

    The other three numbers, and the ground truth, are in the middle of their ranges. A number whose whole range turns
    the rays by less than :data:`STILL` gets weight 0: it is practically fixed, and 1 / S_a would outweigh the others.
    """
    low, high = space.low.double(), space.high.double()
    share = torch.linspace(0, 1, STEPS, dtype=low.dtype, device=low.device)[:, None]
    swept = low + share * (high - low)  # (steps, 4)
    truth = ((low + high) / 2).expand(STEPS, 4)
    points = bearing_grid(grid, torch.full_like(share[:, 0], aspect))
    mean = one_at_a_time(swept, truth, space.parameterization, points).mean(0)
    pace = torch.where(mean > STILL**2, 1 / mean, 0)
    if not pace.any():
        return torch.full_like(pace, 0.25)
    return pace / pace.sum()


#: radians below which errors count by their square: a quarter of a degree
SMALL = 0.005
GRID = 5


class PoseLensLoss(CameraLoss):
    r"""Errors of a camera's gravity direction, focal length and distortion, each by its magnitude.

    .. math:: L = \rho(\hat g - g) + w_f\, \rho(\ln \hat f - \ln f)
              + w_k \frac1n \sum_i \rho\big(c_i(f, \hat k_1) - c_i(f, k_1)\big), \qquad
              \rho(e) = \sqrt{|e|^2 + \epsilon^2} - \epsilon ,

    with g the up direction in the camera frame and :math:`c_i` the unit rays of a grid of image points. If a camera
    points steeply down, its roll hardly moves g and so hardly counts; a loss of the roll itself ignores this. No
    heading is needed. Errors are not squared, so that medians are learnt and crops without any cue to their camera do
    not dominate the others.

    Args:
        space: the parameterization and its ranges.
        focal_weight: weight of the error in the log of the focal length.
        bend_weight: weight of the ray errors that a wrong distortion causes.

    Example:
        >>> import torch
        >>> from sextant.geometry import CameraParameters, Parameterization
        >>> level, up = (CameraParameters(*torch.tensor([[t], [0.0], [1.0], [0.0]])) for t in (0.0, 0.1))
        >>> angles = Parameterization("angles")
        >>> space = ParameterSpace(angles, torch.tensor([-1.0, -1.0, 0.1, -1.0]), torch.tensor([1.0, 1.0, 2.0, 1.0]))
        >>> round(PoseLensLoss(space)(angles.encode(up), angles.encode(level), torch.ones(1)).item(), 2)
        0.1
    """

    @checked
    def __init__(self, space: ParameterSpace, *, focal_weight: Positive = 0.5, bend_weight: Positive = 0.5):
        super().__init__(space)
        self.focal_weight, self.bend_weight = focal_weight, bend_weight

    def forward(
        self, predicted: Float[Tensor, "b 4"], truth: Float[Tensor, "b 4"], aspect: Float[Tensor, "b"]
    ) -> Float[Tensor, "b"]:
        """Loss of each image."""
        _check_batch(predicted, truth, aspect)
        predicted, truth, aspect = at_least_single(predicted, truth, aspect)
        parameterization = self.space.parameterization
        found, true = parameterization.decode(predicted), parameterization.decode(truth)
        gravity = up_in_camera(found.tilt, found.roll) - up_in_camera(true.tilt, true.roll)
        grid, focal = bearing_grid(GRID, aspect), true.focal[:, None]
        bent, straight = (
            perspective_bearings(grid, focal, k1[:, None], parameterization.k2(k1)[:, None])
            for k1 in (found.k1, true.k1)
        )
        lens = _size((found.focal.log() - true.focal.log())[:, None])
        return _size(gravity) + self.focal_weight * lens + self.bend_weight * _size(bent - straight).mean(-1)


def _size(error: Float[Tensor, "*b k"]) -> Float[Tensor, "*b"]:
    return (error.square().sum(-1) + SMALL**2).sqrt() - SMALL


def field_loss(believed: BelievedField, true: PerspectiveField, seen: Bool[Tensor, "b n"]) -> Float[Tensor, "b"]:
    r"""The loss of each picture, averaged over the points that ``seen`` marks.

    .. math:: L = \frac1n \sum_i \ln\sigma_{\varphi,i} + \frac{|\Delta\varphi_i|}{\sigma_{\varphi,i}}
              + \ln\sigma_{\upsilon,i} + \frac{|\Delta\upsilon_i|}{\sigma_{\upsilon,i}} ,

    smallest where each expected error is the mean absolute error.

    >>> true = PerspectiveField(torch.zeros(1, 4), torch.tensor([[0.0, -1.0]]).expand(1, 4, 2))
    >>> sure, unsure = (BelievedField(true, torch.full((1, 2, 4), x), torch.ones(1, 4)) for x in (-2.0, 0.0))
    >>> [field_loss(each, true, torch.ones(1, 4, dtype=torch.bool)).item() for each in (sure, unsure)]
    [-4.0, 0.0]
    """
    errors = field_errors(believed.field, true).abs()
    each = (believed.log_error + errors * torch.exp(-believed.log_error)).sum(-2)
    return (each * seen).sum(-1) / seen.sum(-1).clamp(min=1)
