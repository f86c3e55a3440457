"""A small VGG for images of digits and others of that size: stages of 3x3 convolutions with pooling in between.

Source: K. Simonyan and A. Zisserman, "Very deep convolutional networks for large-scale image recognition", ICLR 2015,
with the batch normalisation of S. Ioffe and C. Szegedy, ICML 2015, and one linear layer in place of three.
"""

import math

from jaxtyping import Float
from torch import Tensor, nn

from sextant.ranges import Count, checked


class SmallVGG(nn.Module):
    """Stages of convolutions with batch normalisation and ReLU; 2x2 max pooling between them; a linear layer.

    Args:
        in_channels: channels of the image.
        image_size: height and width of the image in pixels.
        num_classes: number of logits.
        widths: channels of each stage.
        depths: convolutions of each stage.

    Attributes:
        stages: ``stages.0`` gives a map of the image's size, each later stage one with half the sides.

    Raises:
        ValueError: widths and depths differ in number, or the image is too small to be halved so often.

    Example:
        >>> import torch
        >>> SmallVGG(1, (28, 28), num_classes=10).stages(torch.rand(2, 1, 28, 28)).shape
        torch.Size([2, 64, 7, 7])
    """

    @checked
    def __init__(
        self,
        in_channels: int,
        image_size: tuple[int, int],
        num_classes: int,
        *,
        widths: tuple[Count, ...] = (16, 32, 64),
        depths: tuple[Count, ...] = (1, 2, 2),
    ):
        super().__init__()
        if len(widths) != len(depths):
            raise ValueError(f"{len(widths)} widths need as many depths, got {tuple(depths)}")
        halved = [side // 2 ** (len(widths) - 1) for side in image_size]
        if min(halved) < 1:
            raise ValueError(f"images of {image_size[0]}x{image_size[1]} are too small for {len(widths)} stages")
        stages = []
        for number, (width, depth) in enumerate(zip(widths, depths, strict=True)):
            layers: list[nn.Module] = [nn.MaxPool2d(2)] if number else []
            for layer in range(depth):
                before = width if layer else (widths[number - 1] if number else in_channels)
                layers += [nn.Conv2d(before, width, 3, padding=1, bias=False), nn.BatchNorm2d(width), nn.ReLU()]
            stages.append(nn.Sequential(*layers))
        self.stages = nn.Sequential(*stages)
        self.logits = nn.Linear(widths[-1] * math.prod(halved), num_classes)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Class logits of a batch of images."""
        return self.logits(self.stages(x).flatten(1))  # type: ignore[no-any-return]
