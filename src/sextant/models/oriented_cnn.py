r"""A small network whose first layer computes edge orientations, so that these need not be learnt.

The directions of lines depend on the camera: lines lean (roll), converge (tilt, field of view) and bow (distortion).
A network trained from scratch spends most of its first hundred thousand images on learning edge detectors; here the
first layer is a histogram of oriented gradients in cells, as a fixed function of the image. With the gradient
:math:`(g_x, g_y) = m(\cos\varphi, \sin\varphi)` of the grey image, a pixel votes for orientation b with

.. math:: m \max(0, \cos 2(\varphi - \varphi_b))^2, \qquad \varphi_b = \pi b / B.

Votes are averaged over cells of a few pixels and divided by the mean vote of 3 x 3 cells, so that contrast does not
matter. The log of that mean, the colours and all further channels, averaged over cells, are appended.

Source: N. Dalal, B. Triggs, "Histograms of oriented gradients for human detection", CVPR 2005.
"""

import math
from typing import Annotated, Literal

import torch
import torch.nn.functional as F
from annotated_types import Ge, Le
from jaxtyping import Float
from torch import Tensor, nn

from sextant.layers.cell_means import cell_means
from sextant.layers.depth_first import depth_first
from sextant.models.convolutions import convolutions
from sextant.ranges import Channels, Count, checked

#: gradient, per pixel of an image in [-1, 1], below which there is no edge
FAINT = 0.01


def sobel(grey: Float[Tensor, "b 1 h w"]) -> tuple[Float[Tensor, "b 1 h w"], Float[Tensor, "b 1 h w"]]:
    """Horizontal and vertical gradient by Sobel's filter, per pixel; borders are repeated."""
    g = F.pad(grey, (1, 1, 1, 1), mode="replicate")
    down = g[..., :-2, :] + 2 * g[..., 1:-1, :] + g[..., 2:, :]
    along = g[..., :-2] + 2 * g[..., 1:-1] + g[..., 2:]
    return (down[..., 2:] - down[..., :-2]) / 8, (along[..., 2:, :] - along[..., :-2, :]) / 8


class OrientedGradients(nn.Module):
    """Histograms of edge orientation in cells, together with the averages of all channels; see the module.

    Args:
        orientations: number of bins over half a turn.
        cell: side of a cell in pixels.

    Example:
        >>> gradients = OrientedGradients(orientations=10, cell=4)
        >>> gradients(torch.rand(2, 3, 32, 48)).shape  # ten orientations, contrast and colours
        torch.Size([2, 14, 8, 12])
    """

    votes: Tensor

    def __init__(self, orientations: int = 10, cell: int = 4):
        super().__init__()
        self.cell = cell
        twice = 2 * math.pi * torch.arange(orientations) / orientations
        votes = torch.stack([twice.cos(), twice.sin()], 1)[:, :, None, None]
        self.register_buffer("votes", votes, persistent=False)

    def channels(self, in_channels: int) -> int:
        """Number of output channels."""
        return len(self.votes) + 1 + in_channels

    @torch.no_grad()
    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d h2 w2"]:
        """Cells of images whose first three channels are colours; without gradient, since nothing here is learnt."""
        return depth_first(self._cells, x.contiguous(), self.votes, (1, 1))

    def _cells(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d h2 w2"]:
        gx, gy = sobel((x[:, 0] + x[:, 1] + x[:, 2])[:, None] / 3)
        strength = torch.hypot(gx, gy).add_(1e-6)
        # votes are homogeneous: they are taken of (cos 2 phi, sin 2 phi) times the root of m, then squared
        doubled = torch.cat([gx * gx - gy * gy, 2 * gx * gy], 1).div_(strength.pow(1.5))
        cells = F.avg_pool2d(F.conv2d(doubled, self.votes).relu_().square_(), self.cell)
        local = F.avg_pool2d(cells.sum(1, keepdim=True), 3, 1, 1, count_include_pad=False) + FAINT
        return torch.cat([cells / local, 0.3 * local.log() + 0.5, F.avg_pool2d(x, self.cell)], 1)


class OrientedCNN(nn.Module):
    """Oriented gradients, then 3x3 convolutions with group normalisation and ReLU, pooled to a small grid.

    Args:
        in_channels: channels of the image, the first three its colours.
        image_size: height and width of the image in pixels.
        num_classes: outputs of the last, linear layer.
        widths: channels of the layers, multiples of 8.
        strides: strides of the layers.
        orientations: bins of edge direction.
        cell: side of a cell in pixels.
        grid: height and width of the grid that features are pooled to.

    Raises:
        ValueError: a width is not a multiple of 8, widths and strides differ in number, there are fewer than three
            channels, or the image is too small.

    Example:
        >>> OrientedCNN(3, (96, 128), num_classes=8)(torch.rand(2, 3, 96, 128)).shape
        torch.Size([2, 8])
    """

    @checked
    def __init__(
        self,
        in_channels: int,
        image_size: tuple[int, int],
        num_classes: int,
        *,
        widths: tuple[Channels, ...] = (48, 96, 128, 160),
        strides: tuple[Literal[1, 2], ...] = (1, 2, 2, 1),
        orientations: Annotated[int, Ge(2), Le(64)] = 10,
        cell: Annotated[int, Ge(1), Le(32)] = 4,
        grid: tuple[Count, Count] = (3, 4),
    ):
        super().__init__()
        if in_channels < 3:
            raise ValueError(f"oriented gradients need colour images, got {in_channels} channels")
        smallest = tuple(math.ceil(side // cell / math.prod(strides)) for side in image_size)
        if smallest[0] < grid[0] or smallest[1] < grid[1]:
            raise ValueError(f"images of {image_size[0]}x{image_size[1]} are too small for cells of {cell} pixels")
        self.gradients = OrientedGradients(orientations, cell)
        self.features = convolutions(self.gradients.channels(in_channels), widths, strides)
        self.grid = (grid[0], grid[1])
        self.head = nn.Linear(widths[-1] * grid[0] * grid[1], num_classes)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Outputs of the last layer for a batch of images."""
        cells = self.gradients(x).contiguous(memory_format=torch.channels_last)
        return self.head(cell_means(self.features(cells), self.grid).flatten(1))  # type: ignore[no-any-return]
