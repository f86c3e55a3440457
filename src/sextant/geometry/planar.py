"""Rigid motions in the plane, SE(2), as triples ``(x, y, theta)``: position, and heading in radians counter-clockwise.

A pose ``a_from_b`` maps coordinates of frame b to coordinates of frame a. Returned angles are in [-π, π).
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from sextant.geometry._series import sinc_of_square


def wrap_angle(angle: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """The same angle in [-π, π), with gradient 1; angles already in this range are returned bit for bit.

    But one just below π may come out one rounding step below -π.

    >>> wrap_angle(torch.tensor([0.5, 3.5]))
    tensor([ 0.5000, -2.7832])
    """
    return angle - 2 * math.pi * torch.floor(angle / (2 * math.pi) + 0.5)


def se2_compose(
    a_from_b: Float[Tensor, "*#batch 3"], b_from_c: Float[Tensor, "*#batch 3"]
) -> Float[Tensor, "*#batch 3"]:
    """``a_from_c``: first ``b_from_c``, then ``a_from_b``. Also a robot's pose after the motion ``b_from_c``.

    >>> se2_compose(torch.tensor([1.0, 2.0, torch.pi / 2]), torch.tensor([3.0, 0.0, 0.0]))
    tensor([1.0000, 5.0000, 1.5708])
    """
    moved = a_from_b[..., :2] + _rotate(b_from_c[..., :2], a_from_b[..., 2])
    return _pose(moved, wrap_angle(a_from_b[..., 2] + b_from_c[..., 2]))


def se2_inverse(a_from_b: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    """``b_from_a``.

    >>> se2_inverse(torch.tensor([1.0, 2.0, 0.0]))
    tensor([-1., -2., -0.])
    """
    back = -a_from_b[..., 2]
    return _pose(_rotate(-a_from_b[..., :2], back), wrap_angle(back))


def se2_between(
    a_from_b: Float[Tensor, "*#batch 3"], a_from_c: Float[Tensor, "*#batch 3"]
) -> Float[Tensor, "*#batch 3"]:
    """``b_from_c``: the motion from pose b to pose c, in the frame of b.

    Positions are subtracted first, so that far from the origin no precision is lost beyond that of the positions.

    >>> se2_between(torch.tensor([1.0, 2.0, 0.5]), torch.tensor([1.0, 2.0, 0.75]))
    tensor([0.0000, 0.0000, 0.2500])
    """
    moved = _rotate(a_from_c[..., :2] - a_from_b[..., :2], -a_from_b[..., 2])
    return _pose(moved, wrap_angle(a_from_c[..., 2] - a_from_b[..., 2]))


def se2_exp(twist: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    r"""The pose reached by a constant twist :math:`(v_x, v_y, \omega)` in unit time: an arc of a circle.

    :math:`t = \begin{pmatrix}A & -B\\ B & A\end{pmatrix} v`, :math:`A = \sin\omega/\omega`,
    :math:`B = (1-\cos\omega)/\omega`; smooth at 0.

    >>> se2_exp(torch.tensor([1.0, 0.0, 0.0]))
    tensor([1., 0., 0.])
    """
    angle = twist[..., 2]
    # the chord of the arc: it points half the turn away from the start, and is shorter than the arc by sinc(half)
    chord = _rotate(twist[..., :2], angle / 2) * sinc_of_square(angle * angle / 4)[..., None]
    return _pose(chord, wrap_angle(angle))


def se2_log(pose: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    """The twist with angle in [-π, π) whose exponential is the pose; smooth at 0.

    >>> se2_log(se2_exp(torch.tensor([1.0, 0.0, 0.5])))
    tensor([1.0000, 0.0000, 0.5000])
    """
    angle = wrap_angle(pose[..., 2])
    arc = _rotate(pose[..., :2], -angle / 2) / sinc_of_square(angle * angle / 4)[..., None]
    return _pose(arc, angle)


def _rotate(vectors: Tensor, angle: Tensor) -> Tensor:
    x, y = vectors.unbind(-1)
    cosine, sine = torch.cos(angle), torch.sin(angle)
    return torch.stack([cosine * x - sine * y, sine * x + cosine * y], dim=-1)


def _pose(position: Tensor, angle: Tensor) -> Tensor:
    return torch.cat([position, angle[..., None]], dim=-1)
