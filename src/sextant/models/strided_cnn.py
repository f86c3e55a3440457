"""A small convolutional network that trains in minutes on a CPU."""

import math

from jaxtyping import Float
from torch import Tensor, nn

from sextant.layers.cell_means import cell_means
from sextant.models.convolutions import convolutions
from sextant.ranges import Channels, Count, checked


class StridedCNN(nn.Module):
    """3x3 convolutions of stride 2, each with group normalisation and ReLU, one of stride 1, pooling to a small grid.

    Group normalisation has no batch statistics, so that small batches train well and each picture is treated alone. The
    grid keeps positions in the image, which a mean over the whole image would discard.

    Args:
        in_channels: channels of the image.
        image_size: height and width of the image in pixels.
        num_classes: outputs of the last, linear layer.
        widths: channels of the layers, multiples of 8; all but the last halve the sides.
        grid: height and width of the grid that features are pooled to.

    Raises:
        ValueError: a width is not a multiple of 8, or the image is too small for the layers.

    Example:
        >>> import torch
        >>> network = StridedCNN(3, (96, 128), num_classes=8)
        >>> network.features(torch.rand(2, 3, 96, 128)).shape, network(torch.rand(2, 3, 96, 128)).shape
        (torch.Size([2, 160, 6, 8]), torch.Size([2, 8]))
    """

    @checked
    def __init__(
        self,
        in_channels: int,
        image_size: tuple[int, int],
        num_classes: int,
        *,
        widths: tuple[Channels, ...] = (24, 48, 96, 128, 160),
        grid: tuple[Count, Count] = (3, 4),
    ):
        super().__init__()
        smallest = tuple(math.ceil(side / 2 ** (len(widths) - 1)) for side in image_size)
        if smallest[0] < grid[0] or smallest[1] < grid[1]:
            raise ValueError(f"images of {image_size[0]}x{image_size[1]} are too small for {len(widths)} layers")
        self.features = convolutions(in_channels, widths, (2,) * (len(widths) - 1) + (1,))
        self.grid = (grid[0], grid[1])
        self.head = nn.Linear(widths[-1] * grid[0] * grid[1], num_classes)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Outputs of the last layer for a batch of images."""
        return self.head(cell_means(self.features(x), self.grid).flatten(1))  # type: ignore[no-any-return]
