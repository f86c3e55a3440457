"""Rigid motions in space, SE(3), as matrices ``a_from_b`` that take the coordinates of frame b to those of frame a.

They are 4 x 4, or 3 x 4 without the last row; what is returned is 4 x 4. ``a_from_b`` composed with ``b_from_c`` is
``a_from_c``. World frames have z up. Angles are in radians.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from sextant.geometry._series import sinc_deficit_of_square, sinc_of_square
from sextant.geometry.camera import floating
from sextant.geometry.rotations import rotation_from_tilt_roll, so3_exp, so3_hat, so3_log


def se3_from_rotation_translation(
    rotation: Float[Tensor, "*#batch 3 3"], translation: Float[Tensor, "*#batch 3"]
) -> Float[Tensor, "*#batch 4 4"]:
    """The pose that rotates, then translates.

    >>> se3_from_rotation_translation(torch.eye(3), torch.tensor([1.0, 2.0, 3.0]))
    tensor([[1., 0., 0., 1.],
            [0., 1., 0., 2.],
            [0., 0., 1., 3.],
            [0., 0., 0., 1.]])
    """
    batch = torch.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    upper = torch.cat([rotation.expand(*batch, 3, 3), translation.expand(*batch, 3)[..., None]], dim=-1)
    last = torch.tensor([0, 0, 0, 1], dtype=upper.dtype, device=upper.device).expand(*batch, 1, 4)
    return torch.cat([upper, last], dim=-2)


def se3_compose(
    a_from_b: Float[Tensor, "*#batch rows_ab 4"], b_from_c: Float[Tensor, "*#batch rows_bc 4"]
) -> Float[Tensor, "*#batch 4 4"]:
    """``a_from_c``: first ``b_from_c``, then ``a_from_b``.

    >>> step = se3_from_rotation_translation(torch.eye(3), torch.tensor([1.0, 0.0, 0.0]))
    >>> se3_compose(step, step)[:3, 3]
    tensor([2., 0., 0.])
    """
    rotation = a_from_b[..., :3, :3]
    moved = (rotation @ b_from_c[..., :3, 3:]).squeeze(-1) + a_from_b[..., :3, 3]
    return se3_from_rotation_translation(rotation @ b_from_c[..., :3, :3], moved)


def se3_inverse(a_from_b: Float[Tensor, "*batch rows 4"]) -> Float[Tensor, "*batch 4 4"]:
    """``b_from_a``: the transposed rotation, and ``-R^T t``.

    >>> pose = se3_from_rotation_translation(torch.eye(3), torch.tensor([1.0, 2.0, 3.0]))
    >>> se3_inverse(pose)[:3, 3]
    tensor([-1., -2., -3.])
    """
    back = a_from_b[..., :3, :3].mT
    return se3_from_rotation_translation(back, -(back @ a_from_b[..., :3, 3:]).squeeze(-1))


def transform_points(
    a_from_b: Float[Tensor, "*#batch rows 4"], points: Float[Tensor, "*#batch n 3"]
) -> Float[Tensor, "*#batch n 3"]:
    """The coordinates in frame a of points given in frame b: ``R p + t`` for each of the n points.

    >>> pose = se3_from_rotation_translation(torch.eye(3), torch.tensor([1.0, 2.0, 3.0]))
    >>> transform_points(pose, torch.zeros(1, 3))
    tensor([[1., 2., 3.]])
    """
    return points @ a_from_b[..., :3, :3].mT + a_from_b[..., None, :3, 3]


def se3_exp(twist: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch 4 4"]:
    r"""The pose reached by a constant twist ``(v, w)`` - translation first - in unit time: :math:`(e^{\hat w}, V v)`.

    :math:`V = I + \frac{1-\cos a}{a^2}K + \frac{a-\sin a}{a^3}K^2` with :math:`K = \hat w`, :math:`a = |w|`.

    >>> se3_exp(torch.tensor([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))[:3, 3]
    tensor([1., 0., 0.])
    """
    translation, vector = twist[..., :3], twist[..., 3:]
    moved = (_left_jacobian(vector) @ translation[..., None]).squeeze(-1)
    return se3_from_rotation_translation(so3_exp(vector), moved)


def se3_log(pose: Float[Tensor, "*batch rows 4"]) -> Float[Tensor, "*batch 6"]:
    """The twist ``(v, w)`` with ``|w| <= π`` whose exponential is the pose.

    >>> twist = torch.tensor([1.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    >>> torch.allclose(se3_log(se3_exp(twist)), twist, atol=1e-6)
    True
    """
    vector = so3_log(pose[..., :3, :3])
    translation = torch.linalg.solve(_left_jacobian(vector), pose[..., :3, 3:]).squeeze(-1)
    return torch.cat([translation, vector], dim=-1)


def _left_jacobian(vector: Tensor) -> Tensor:
    """V of :func:`se3_exp`; its determinant is ``(sin(a/2) / (a/2))^2``, so it is invertible for angles below 2π."""
    square = vector.square().sum(dim=-1)[..., None, None]
    skew = so3_hat(vector)
    half = sinc_of_square(square / 4)
    identity = torch.eye(3, dtype=vector.dtype, device=vector.device)
    return identity + half * half / 2 * skew + sinc_deficit_of_square(square) * (skew @ skew)


def level_camera_pose(
    x: float | Float[Tensor, "*#batch"],
    y: float | Float[Tensor, "*#batch"],
    z: float | Float[Tensor, "*#batch"],
    heading: float | Float[Tensor, "*#batch"],
    tilt: float | Float[Tensor, "*#batch"] = 0.0,
    roll: float | Float[Tensor, "*#batch"] = 0.0,
) -> Float[Tensor, "*#batch 4 4"]:
    """``world_from_camera`` of a camera at ``(x, y, z)`` that looks along ``heading``, tilted and rolled.

    ``R = [right, down, forward] Rx(tilt) Rz(roll)`` with right ``(sin h, -cos h, 0)``, down ``(0, 0, -1)`` and forward
    ``(cos h, sin h, 0)``: ``heading`` runs counter-clockwise from the world's x axis, and ``tilt > 0`` looks up.
    Numbers take the type and device of the first tensor among the arguments, or torch's default.

    >>> pose = level_camera_pose(1.0, 2.0, 1.6, heading=0.0)
    >>> pose[:3, 3], pose[:3, 2]  # where it is, and where it looks
    (tensor([1.0000, 2.0000, 1.6000]), tensor([1., 0., 0.]))
    """
    arguments = (x, y, z, heading, tilt, roll)
    like = floating(next((value for value in arguments if isinstance(value, Tensor)), torch.empty(())))
    tensors = [torch.as_tensor(value, dtype=like.dtype, device=like.device) for value in arguments]
    *position, angle, up, turn = torch.broadcast_tensors(*tensors)
    cosine, sine, zero = torch.cos(angle), torch.sin(angle), torch.zeros_like(angle)
    rows = [sine, zero, cosine, -cosine, zero, sine, zero, zero - 1, zero]
    world_from_gravity = torch.stack(rows, dim=-1).reshape(*angle.shape, 3, 3)
    rotation = world_from_gravity @ rotation_from_tilt_roll(up, turn)
    return se3_from_rotation_translation(rotation, torch.stack(position, dim=-1))
