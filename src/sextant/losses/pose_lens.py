r"""Errors of a camera's gravity direction, focal length and distortion, each on its own and by its size.

.. math:: L = \rho(\hat g - g) + w_f\, \rho(\ln \hat f - \ln f)
          + w_k \frac1n \sum_i \rho\big(c_i(f, \hat k_1) - c_i(f, k_1)\big), \qquad
          \rho(e) = \sqrt{|e|^2 + \epsilon^2} - \epsilon ,

with g the up direction in the camera frame and :math:`c_i` the unit rays of a grid of image points. Where a camera
looks steeply down, its roll hardly moves g and so hardly counts; a loss of the roll itself ignores this. No heading is
needed. Errors count by their size rather than its square, so that medians are learnt and a crop that shows nothing of
its camera does not drown the others.
"""

from jaxtyping import Float
from torch import Tensor

from sextant.geometry import ParameterSpace, perspective_bearings
from sextant.geometry.rotations import up_in_camera
from sextant.losses.bearing import bearing_grid
from sextant.losses.camera_loss import CameraLoss, at_least_single

#: radians below which errors count by their square: a quarter of a degree
SMALL = 0.005
GRID = 5


class PoseLensLoss(CameraLoss):
    """The loss of the module.

    Args:
        space: the parameterization and its ranges.
        focal_weight: weight of the error in the log of the focal length.
        bend_weight: weight of the turn of rays by a wrong distortion.

    Example:
        >>> import torch
        >>> from sextant.geometry import CameraParameters, Parameterization
        >>> level, up = (CameraParameters(*torch.tensor([[t], [0.0], [1.0], [0.0]])) for t in (0.0, 0.1))
        >>> angles = Parameterization("angles")
        >>> space = ParameterSpace(angles, torch.tensor([-1.0, -1.0, 0.1, -1.0]), torch.tensor([1.0, 1.0, 2.0, 1.0]))
        >>> round(PoseLensLoss(space)(angles.encode(up), angles.encode(level), torch.ones(1)).item(), 2)
        0.1
    """

    def __init__(self, space: ParameterSpace, *, focal_weight: float = 0.5, bend_weight: float = 0.5):
        super().__init__(space)
        self.focal_weight, self.bend_weight = focal_weight, bend_weight

    def forward(
        self, predicted: Float[Tensor, "b 4"], truth: Float[Tensor, "b 4"], aspect: Float[Tensor, "b"]
    ) -> Float[Tensor, "b"]:
        """Loss of each image."""
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
