"""What every camera can do: turn pixels into rays and directions into pixels.

Pixels are ``(column, row)`` from the top left corner of the image, so that pixel ``(i, j)`` has its centre at
``(i + 0.5, j + 0.5)``. The camera frame has x right, y down, z forward.
"""

from abc import ABC, abstractmethod
from numbers import Integral

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from sextant.errors import UserError


class Camera(ABC):
    """A central camera with an image of ``width`` by ``height`` pixels, or a batch of such cameras.

    The dimensions of a batch come first in everything that is given or returned: a batch of B cameras takes points of
    shape ``(B, *n, 2)``, or ``(1, *n, 2)`` for points that all of them share.
    """

    width: int
    height: int

    @abstractmethod
    def bearings(self, points: Float[Tensor, "*n 2"]) -> Float[Tensor, "*m 3"]:
        """Unit directions, in the camera frame, of the rays through ``points`` (pixels)."""

    @abstractmethod
    def project(self, directions: Float[Tensor, "*n 3"]) -> tuple[Float[Tensor, "*m 2"], Bool[Tensor, "*m"]]:
        """Pixels at which ``directions`` (of any length but 0, camera frame) are seen, and whether they are.

        The second result is false where the camera has no pixel for the direction, even on an unlimited image; there
        the pixel means nothing. See :meth:`contains` for the borders of the image.
        """

    @property
    def batch_shape(self) -> torch.Size:
        """Shape of the batch of cameras; empty for one camera."""
        return torch.Size()

    @property
    def dtype(self) -> torch.dtype:
        """Type of the points that the camera makes."""
        return torch.get_default_dtype()

    @property
    def device(self) -> torch.device:
        """Device of the points that the camera makes."""
        return torch.device("cpu")

    def contains(self, points: Float[Tensor, "*n 2"]) -> Bool[Tensor, "*n"]:
        """Whether pixels lie on the image: ``0 <= column < width`` and ``0 <= row < height``."""
        column, row = points.unbind(-1)
        return (column >= 0) & (column < self.width) & (row >= 0) & (row < self.height)

    def ray_grid(
        self, samples_per_side: int = 1, *, dtype: torch.dtype | None = None, device: torch.device | str | None = None
    ) -> Float[Tensor, "*one height width samples 2"]:
        """Points on a regular n x n grid inside every pixel, row by row, for ``n = samples_per_side``.

        The mean over ``samples`` (n * n of them) of what the rays see is the pixel's value. A batch of cameras shares
        the points: its dimensions are there, each of size 1. Type and device are the camera's unless given.

        Raises:
            ValueError: ``samples_per_side`` is below 1.
        """
        if samples_per_side < 1:
            raise ValueError(f"samples_per_side must be at least 1, got {samples_per_side}")
        dtype, device = dtype or self.dtype, device or self.device
        inside = (torch.arange(samples_per_side, dtype=dtype, device=device) + 0.5) / samples_per_side
        rows = torch.arange(self.height, dtype=dtype, device=device).view(-1, 1, 1, 1) + inside.view(
            -1, 1
        )  # (H, 1, n, 1)
        columns = torch.arange(self.width, dtype=dtype, device=device).view(-1, 1, 1) + inside  # (W, 1, n)
        grid = torch.stack(torch.broadcast_tensors(columns, rows), dim=-1)  # (H, W, n, n, 2)
        return grid.reshape(*[1] * len(self.batch_shape), self.height, self.width, -1, 2)

    def pixel_centres(
        self, *, dtype: torch.dtype | None = None, device: torch.device | str | None = None
    ) -> Float[Tensor, "*one height width 2"]:
        """The centre of every pixel: :meth:`ray_grid` with one sample a pixel."""
        return self.ray_grid(1, dtype=dtype, device=device).squeeze(-2)


def heights_from_pixels(points: Float[Tensor, "*n 2"], width: int, height: int) -> Float[Tensor, "*n 2"]:
    """Image coordinates in image heights from the centre: ``u = (column - W/2) / H``, ``v = (row - H/2) / H``, down.

    >>> heights_from_pixels(torch.tensor([[0.0, 0.0], [320.0, 240.0]]), 640, 480)
    tensor([[-0.6667, -0.5000],
            [ 0.0000,  0.0000]])
    """
    points = floating(points)
    return (points - points.new_tensor([width / 2, height / 2])) / height


def pixels_from_heights(points: Float[Tensor, "*n 2"], width: int, height: int) -> Float[Tensor, "*n 2"]:
    """The inverse of :func:`heights_from_pixels`.

    >>> pixels_from_heights(torch.tensor([0.0, 0.5]), 640, 480)
    tensor([320., 480.])
    """
    points = floating(points)
    return points * height + points.new_tensor([width / 2, height / 2])


def floating(values: Tensor) -> Tensor:
    """Whole numbers as floating-point ones of torch's default type, since half of a pixel would be cut off."""
    return values if values.is_floating_point() else values.to(torch.get_default_dtype())


def check_image_size(width: int, height: int) -> None:
    """Raise a ``UserError`` unless both sides of an image are whole numbers of at least one pixel."""
    if any(isinstance(side, bool) or not isinstance(side, Integral) or side < 1 for side in (width, height)):
        raise UserError(
            f"the width and height of an image are whole numbers of at least 1 pixel, got width={width}, "
            f"height={height}",
            "For example width=320, height=240.",
        )
