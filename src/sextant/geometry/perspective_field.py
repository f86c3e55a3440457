r"""The perspective field of a camera: the latitude and up direction at each point of its image.

With b the unit ray of an image point and g up in the camera frame, the *latitude* of the point is
:math:`\arcsin(b \cdot g)`. Its *up direction* is that in which the image point moves when its scene point is lifted:

.. math:: \dot p = g_{xy} - g_z\, p, \qquad u \propto d\, \dot p + 2 (k_1 + 2 k_2 r^2)(p \cdot \dot p)\, p ,

with :math:`p = b_{xy} / b_z`, :math:`r = |p|` and the distortion :math:`d = 1 + k_1 r^2 + k_2 r^4`. One point hardly
constrains a camera, but all together determine it (:mod:`sextant.geometry.field_fit`).

Source: L. Jin et al., "Perspective Fields for single image camera calibration", CVPR 2023.
"""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from sextant.geometry.distortion import K2Family, distortion_factor, k2_of_k1
from sextant.geometry.parameterization import CameraParameters
from sextant.geometry.perspective import perspective_bearings
from sextant.geometry.rotations import up_in_camera

#: largest sine of a latitude, least depth of a ray, and a term added to a cosine; they only keep gradients finite
STEEPEST, NEAREST, TINY = 0.9999, 0.02, 1e-6


class PerspectiveField(NamedTuple):
    """Latitudes and up directions of n image points.

    Attributes:
        latitude: radians, 0 at the horizon and positive above it.
        up: unit directions in the image, x to the right and y down.
    """

    latitude: Float[Tensor, "*b n"]
    up: Float[Tensor, "*b n 2"]


def perspective_field(
    camera: CameraParameters, points: Float[Tensor, "*#b n 2"], family: K2Family = "lopez"
) -> PerspectiveField:
    """The field of cameras at image points, in image heights from the centre; differentiable in the cameras.

    >>> level = CameraParameters(*torch.tensor([0.0, 0.0, 0.5, 0.0]))
    >>> field = perspective_field(level, torch.tensor([[0.0, 0.0], [0.0, -0.5]]))
    >>> torch.rad2deg(field.latitude), field.up
    (tensor([ 0., 45.]), tensor([[ 0., -1.],
            [ 0., -1.]]))
    """
    up = up_in_camera(camera.tilt, camera.roll)[..., None, :]
    k1 = camera.k1[..., None]
    k2 = k2_of_k1(k1, family)
    rays = perspective_bearings(points, camera.focal[..., None], k1, k2)
    latitude = torch.asin((rays * up).sum(-1).clamp(-STEEPEST, STEEPEST))
    ideal = rays[..., :2] / rays[..., 2:].clamp(min=NEAREST)
    lifted = up[..., :2] - up[..., 2:] * ideal
    square = ideal.square().sum(-1)
    bend = 2 * (k1 + 2 * k2 * square) * (ideal * lifted).sum(-1)
    moved = distortion_factor(square, k1, k2)[..., None] * lifted + bend[..., None] * ideal
    return PerspectiveField(latitude, F.normalize(moved, dim=-1, eps=1e-9))


def field_errors(found: PerspectiveField, true: PerspectiveField) -> Float[Tensor, "*b 2 n"]:
    """Found minus true latitudes, and angles from the true to the found up directions, from x to y; radians.

    >>> level, rolled = (CameraParameters(*torch.tensor([0.0, roll, 0.5, 0.0])) for roll in (0.0, 0.1))
    >>> centre = torch.zeros(1, 2)
    >>> field_errors(perspective_field(rolled, centre), perspective_field(level, centre))
    tensor([[ 0.0000],
            [-0.1000]])
    """
    cross = true.up[..., 0] * found.up[..., 1] - true.up[..., 1] * found.up[..., 0]
    turn = torch.atan2(cross, (found.up * true.up).sum(-1) + TINY)
    return torch.stack([found.latitude - true.latitude, turn], -2)
