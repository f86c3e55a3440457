r"""Rotations in space, SO(3): tilt and roll of a camera, exponential and logarithm.

The gravity frame has the axes of a level camera (x right, y down, z forward horizontally); heading is not in it.
Angles are in radians.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from sextant.geometry._series import sinc_of_square


def rotation_from_tilt_roll(
    tilt: Float[Tensor, "*#batch"], roll: Float[Tensor, "*#batch"]
) -> Float[Tensor, "*#batch 3 3"]:
    r"""``gravity_from_camera`` :math:`= R_x(\theta) R_z(\psi)` of a camera with tilt θ and roll ψ.

    ``tilt > 0`` looks up; ``roll > 0`` lowers the camera's right side, so that the picture turns counter-clockwise.

    >>> rotation_from_tilt_roll(torch.tensor(0.0), torch.tensor(0.0))
    tensor([[1., -0., 0.],
            [0., 1., -0.],
            [0., 0., 1.]])
    """
    tilt, roll = torch.broadcast_tensors(tilt, roll)
    ct, st, cr, sr = torch.cos(tilt), torch.sin(tilt), torch.cos(roll), torch.sin(roll)
    rows = [cr, -sr, torch.zeros_like(ct), ct * sr, ct * cr, -st, st * sr, st * cr, ct]
    return torch.stack(rows, dim=-1).reshape(*tilt.shape, 3, 3)


def up_in_camera(tilt: Float[Tensor, "*#batch"], roll: Float[Tensor, "*#batch"]) -> Float[Tensor, "*#batch 3"]:
    r"""Up in the camera frame, of length 1: :math:`(-\sin\psi\cos\theta, -\cos\psi\cos\theta, \sin\theta)`.

    >>> up_in_camera(torch.tensor(torch.pi / 6), torch.tensor(0.0))
    tensor([-0.0000, -0.8660,  0.5000])
    """
    tilt, roll = torch.broadcast_tensors(tilt, roll)
    level = torch.cos(tilt)
    return torch.stack([-torch.sin(roll) * level, -torch.cos(roll) * level, torch.sin(tilt)], dim=-1)


def tilt_roll_from_up(up: Float[Tensor, "*batch 3"]) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
    """Tilt in [-π/2, π/2] and roll in [-π, π] from up in the camera frame, of any length: the inverse of the above.

    ``roll = atan2(-x, -y)``, ``tilt = atan2(z, |(x, y)|)``; a camera that looks straight up or down has no roll, and 0
    is returned, without gradient.

    >>> tilt_roll_from_up(torch.tensor([0.0, -1.0, 1.0]))
    (tensor(0.7854), tensor(-0.))
    """
    x, y, z = up.unbind(-1)
    vertical = (x == 0) & (y == 0)
    x, y = torch.where(vertical, 0, -x), torch.where(vertical, 1, -y)
    level = torch.where(vertical, 0, (x * x + y * y).sqrt())
    return torch.atan2(z, level), torch.atan2(x, y)


def so3_hat(vector: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """The skew matrix with ``hat(a) b = a x b``.

    >>> so3_hat(torch.tensor([1.0, 2.0, 3.0]))
    tensor([[ 0., -3.,  2.],
            [ 3.,  0., -1.],
            [-2.,  1.,  0.]])
    """
    x, y, z = vector.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).reshape(*x.shape, 3, 3)


def so3_exp(vector: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    r"""The rotation about ``vector`` by its length: :math:`I + \frac{\sin a}{a}K + \frac{1-\cos a}{a^2}K^2`.

    (Rodrigues' formula.) Accurate and smooth everywhere, with all its derivatives at 0 too.

    >>> so3_exp(torch.tensor([0.0, 0.0, torch.pi])).round(decimals=4)
    tensor([[-1.,  0.,  0.],
            [-0., -1.,  0.],
            [ 0.,  0.,  1.]])
    """
    square = vector.square().sum(dim=-1)
    first, half = sinc_of_square(square), sinc_of_square(square / 4)
    skew = so3_hat(vector)
    identity = torch.eye(3, dtype=vector.dtype, device=vector.device)
    return identity + first[..., None, None] * skew + (half * half / 2)[..., None, None] * (skew @ skew)


def so3_log(rotation: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 3"]:
    """The vector of length at most π whose exponential is ``rotation``; at length π either of the two.

    By the unit quaternion, which is as accurate at angle 0 as at π, where the trace of the matrix says nothing.

    >>> so3_log(so3_exp(torch.tensor([0.0, 0.0, 0.5])))
    tensor([0.0000, 0.0000, 0.5000])
    """
    quaternion = _quaternion(rotation)
    quaternion = torch.where(quaternion[..., :1] < 0, -quaternion, quaternion)
    cosine, axis = quaternion[..., 0], quaternion[..., 1:]
    square = axis.square().sum(dim=-1)  # sin^2 of half the angle
    small = square < 1e-4
    sine = torch.where(small, 1, square).sqrt()
    series = 2 + square * (1 / 3 + square * (3 / 20 + square * (5 / 56)))  # of 2 asin(s) / s
    scale = torch.where(small, series, 2 * torch.atan2(sine, cosine) / sine)
    return scale[..., None] * axis


def _quaternion(rotation: Tensor) -> Tensor:
    """Unit quaternion (w, x, y, z) of a rotation, from whichever of its four squares is largest (Shepperd 1978)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = (row.unbind(-1) for row in rotation.unbind(-2))
    # the rows are 4 q_i q of the unit quaternion q, for i = w, x, y, z
    products = [
        [1 + xx + yy + zz, zy - yz, xz - zx, yx - xy],
        [zy - yz, 1 + xx - yy - zz, yx + xy, xz + zx],
        [xz - zx, yx + xy, 1 - xx + yy - zz, zy + yz],
        [yx - xy, xz + zx, zy + yz, 1 - xx - yy + zz],
    ]
    outer = torch.stack([torch.stack(row, dim=-1) for row in products], dim=-2)  # (*batch, 4, 4)
    largest = outer.diagonal(dim1=-2, dim2=-1).argmax(dim=-1)
    row = outer.gather(-2, largest[..., None, None].expand(*largest.shape, 1, 4)).squeeze(-2)
    length: Tensor = torch.linalg.vector_norm(row, dim=-1, keepdim=True)
    return row / length
