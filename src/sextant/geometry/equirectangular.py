"""The panorama: all directions on one image, longitude along its columns and latitude along its rows."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from sextant.errors import UserError
from sextant.geometry.camera import Camera, check_image_size, floating
from sextant.shapes import check_shape


@dataclass(frozen=True)
class EquirectangularCamera(Camera):
    r"""A full panorama of 360 x 180 degrees, forward (z) at the centre, longitude to the right, up at the top.

    :math:`\lambda = 2\pi(c/W - 1/2)`, :math:`\varphi = \pi(1/2 - r/H)` for column c and row r, and the direction is
    :math:`(\cos\varphi\sin\lambda, -\sin\varphi, \cos\varphi\cos\lambda)` with x right, y down, z forward.
    The left and right edges are one meridian, behind the camera.

    >>> EquirectangularCamera(1024, 512).bearings(torch.tensor([512.0, 256.0])).round(decimals=4)
    tensor([0., -0., 1.])

    Args:
        width: columns, twice the rows.
        height: rows.

    Raises:
        UserError: the image is not twice as wide as high, or is empty.
    """

    width: int
    height: int

    def __post_init__(self) -> None:
        check_image_size(self.width, self.height)
        if self.width != 2 * self.height:
            raise UserError(
                f"a full panorama is twice as wide as high, got width={self.width}, height={self.height}",
                f"For example width={2 * self.height}, height={self.height}.",
            )

    def bearings(self, points: Float[Tensor, "*n 2"]) -> Float[Tensor, "*n 3"]:
        """Unit directions, in the camera frame, of the rays through ``points`` (pixels)."""
        check_shape("points", points, ..., 2)
        longitude = 2 * math.pi * (points[..., 0] / self.width - 0.5)
        latitude = math.pi * (0.5 - points[..., 1] / self.height)
        horizontal = torch.cos(latitude)
        x, z = horizontal * torch.sin(longitude), horizontal * torch.cos(longitude)
        return torch.stack([x, -torch.sin(latitude), z], dim=-1)

    def project(self, directions: Float[Tensor, "*n 3"]) -> tuple[Float[Tensor, "*n 2"], Bool[Tensor, "*n"]]:
        """Pixels at which ``directions`` are seen: all are, but for the direction of length 0.

        Columns lie in ``[0, width)``. The poles, seen along a whole row, get the column of the centre, without
        gradient.
        """
        check_shape("directions", directions, ..., 3)
        x, y, z = floating(directions).unbind(-1)
        pole = (x == 0) & (z == 0)
        ahead = torch.where(pole, 1, z)
        longitude = torch.atan2(torch.where(pole, 0, x), ahead)
        horizontal = torch.where(pole, 0, (x * x + ahead * ahead).sqrt())
        latitude = torch.atan2(torch.where(pole & (y == 0), 0, -y), torch.where(pole & (y == 0), 1, horizontal))
        columns = torch.remainder((longitude / (2 * math.pi) + 0.5) * self.width, self.width)
        rows = (0.5 - latitude / math.pi) * self.height
        return torch.stack([columns, rows], dim=-1), ~pole | (y != 0)
