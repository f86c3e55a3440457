r"""The bearing loss: how far the rays of image points turn when the predicted camera replaces the true one.

In the gravity frame, an image point :math:`u_i` has the bearing :math:`p_i(\Omega) = R(\theta, \psi)\, c_i`, with
c_i its unit ray in the camera frame. Over a regular grid of n points

.. math:: L(\hat\Omega, \Omega) = \frac1n \sum_i \|p_i(\hat\Omega) - p_i(\Omega)\|^2 .

This gives the four numbers one meaningful unit, but they can compensate for each other's errors. The *disentangled*
loss prevents this: for each number a, only a is taken from the prediction and the other three from the ground truth,
:math:`L^* = \sum_a w_a L_a`, with :math:`w_a = \frac14`. The *harmonic* one uses the weights :math:`w_a \propto
1/S_a`, with S_a the mean of L_a when a runs over its range, so that all four learn at the same pace.

Source: M. Lopez-Antequera et al., "Deep single image camera calibration with radial distortion", CVPR 2019, section 4;
disentangling: A. Simonelli et al., "Disentangling monocular 3D object detection", ICCV 2019; weights: N. Wakai et al.,
"Rethinking generic camera models for deep single image camera calibration", ECCV 2022.
"""

from typing import Literal, get_args

import torch
from jaxtyping import Float
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.geometry import CameraParameters, Parameterization, ParameterSpace, perspective_bearings
from sextant.geometry.rotations import rotation_from_tilt_roll
from sextant.losses.camera_loss import CameraLoss, at_least_single

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
    """Mean squared difference of bearings over a grid of image points; see the module.

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

    def __init__(self, space: ParameterSpace, *, mode: Mode = "disentangled", grid: int = 7):
        super().__init__(space)
        if mode not in get_args(Mode):
            raise ArgumentError(f"mode={mode!r} must be one of {', '.join(get_args(Mode))}", "mode=disentangled")
        if grid < 2:
            raise ArgumentError(f"grid={grid} must be at least 2 points per side", "For example grid=7")
        self.mode, self.grid = mode, grid
        weights = harmonic_weights(space, grid) if mode == "harmonic" else torch.full((4,), 0.25)
        self.register_buffer("weights", weights.float(), persistent=False)

    def forward(
        self, predicted: Float[Tensor, "b 4"], truth: Float[Tensor, "b 4"], aspect: Float[Tensor, "b"]
    ) -> Float[Tensor, "b"]:
        """Mean squared bearing difference of each image."""
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
    the rays by less than :data:`STILL` gets weight 0: it is practically fixed, and 1 / S_a would leave nothing for the
    others.
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
