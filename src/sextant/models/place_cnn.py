"""A small network for place recognition, which trains in minutes on a CPU with images of 64x32 to 96x64 pixels.

The positions of edges identify a place in any light. The first layer, which has no weights, therefore removes the
light: it subtracts the local mean from every pixel and divides by the local contrast. Group normalisation treats each
image alone; batch statistics would mix the conditions of a batch.
"""

import math
from typing import Annotated, Literal

import torch
import torch.nn.functional as F
from annotated_types import Ge, Le
from jaxtyping import Float
from torch import Tensor, nn

from sextant.models.convolutions import convolutions
from sextant.ranges import Channels, checked

#: contrast, of images in [-1, 1], below which it is suppressed as noise
FAINT = 0.02


class LocalContrast(nn.Module):
    r"""Local contrast normalisation: :math:`(x - \mu) / \sqrt{\sigma^2 + \epsilon^2}`, over a square around the pixel.

    One mean and one deviation serve all channels, so that a colour cast and the colours themselves remain. At the
    border, only the part of the square within the image counts.

    Source: K. Jarrett et al., "What is the best multi-stage architecture for object recognition?", ICCV 2009, with a
    square in place of a Gaussian.

    Args:
        window: side of the square in pixels, odd.

    Raises:
        ValueError: the side is even or below 3.

    Example:
        >>> image = torch.rand(1, 3, 16, 16)
        >>> torch.allclose(LocalContrast(5)(image), LocalContrast(5)(image + 0.2), atol=1e-3)  # brighter all over
        True
    """

    def __init__(self, window: int):
        super().__init__()
        if window < 3 or window % 2 == 0:
            raise ValueError(f"window must be odd and at least 3, got {window}")
        self.window = window

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        """Images without their local brightness and contrast."""
        centred = x - self._mean(x.mean(1, keepdim=True))
        variance = self._mean(centred.square().mean(1, keepdim=True))
        return centred / (variance + FAINT**2).sqrt()

    def _mean(self, x: Tensor) -> Tensor:
        sides, half = (self.window, 1), self.window // 2
        x = F.avg_pool2d(x, sides, 1, (half, 0), count_include_pad=False)
        return F.avg_pool2d(x, sides[::-1], 1, (0, half), count_include_pad=False)


class PlaceCNN(nn.Module):
    """Local contrast, then 3x3 convolutions with group normalisation and ReLU; ``features`` is the map for places.

    Args:
        in_channels: channels of the image.
        image_size: height and width of the image in pixels.
        num_classes: outputs of a linear layer on the mean of the map; :class:`~sextant.models.FeatureMap` drops it.
        widths: channels of the layers, multiples of 8.
        strides: strides of the layers.
        window: side of the square of :class:`LocalContrast`, or None for images as they are.

    Raises:
        ValueError: a width is not a multiple of 8, widths and strides differ in number, or the image is too small.

    Example:
        >>> PlaceCNN(3, (64, 96), num_classes=8).features(torch.rand(2, 3, 64, 96)).shape
        torch.Size([2, 128, 8, 12])
    """

    @checked
    def __init__(
        self,
        in_channels: int,
        image_size: tuple[int, int],
        num_classes: int,
        *,
        widths: tuple[Channels, ...] = (32, 64, 96, 128),
        strides: tuple[Literal[1, 2], ...] = (1, 2, 2, 2),
        window: Annotated[int, Ge(3), Le(255)] | None = 9,
    ):
        super().__init__()
        if min(image_size) < math.prod(strides):
            raise ValueError(f"images of {image_size[0]}x{image_size[1]} are too small for strides {tuple(strides)}")
        self.contrast = nn.Identity() if window is None else LocalContrast(window)
        self.features = convolutions(in_channels, widths, strides)
        self.head = nn.Linear(widths[-1], num_classes)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Outputs of the last layer for a batch of images in [-1, 1]."""
        x = self.contrast(x).contiguous(memory_format=torch.channels_last)
        return self.head(self.features(x).mean((2, 3)))  # type: ignore[no-any-return]
