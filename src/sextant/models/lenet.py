"""LeNet in the four sizes of the push-pull paper.

Source: Y. LeCun et al., "Gradient-based learning applied to document recognition", 1998; widths A-D from Strisciuglio
et al. 2020, table 1. The paper states neither kernel size nor padding: 5x5 and 2 ("same" in the first layer) are ours.
"""

from typing import Literal

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from sextant.ranges import checked

Variant = Literal["A", "B", "C", "D"]

#: variant -> channels of the two convolutions, units of the two hidden layers
WIDTHS: dict[str, tuple[int, int, int, int]] = {
    "A": (6, 16, 128, 64),
    "B": (6, 8, 64, 32),
    "C": (4, 16, 128, 64),
    "D": (4, 8, 64, 32),
}


class LeNet(nn.Module):
    """Two 5x5 convolutions, each with ReLU and 2x2 max pooling, and three fully connected layers.

    Args:
        variant: widths of the layers, ``A`` to ``D``.
        in_channels: channels of the image.
        image_size: height and width of the image in pixels, at least 12 each.
        num_classes: number of logits.

    Raises:
        ValueError: the image is too small for two convolutions and poolings.

    Example:
        >>> import torch
        >>> LeNet("A", 1, (28, 28), num_classes=10)(torch.rand(2, 1, 28, 28)).shape
        torch.Size([2, 10])
    """

    @checked
    def __init__(self, variant: Variant, in_channels: int, image_size: tuple[int, int], num_classes: int):
        super().__init__()
        first, second, hidden1, hidden2 = WIDTHS[variant]
        height, width = (((side // 2) - 4) // 2 for side in image_size)
        if min(height, width) < 1:
            raise ValueError(f"LeNet needs images of at least 12x12 pixels, got {image_size[0]}x{image_size[1]}")
        self.conv1 = nn.Conv2d(in_channels, first, 5, padding=2)
        self.conv2 = nn.Conv2d(first, second, 5)
        self.hidden1 = nn.Linear(second * height * width, hidden1)
        self.hidden2 = nn.Linear(hidden1, hidden2)
        self.logits = nn.Linear(hidden2, num_classes)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Class logits of a batch of images."""
        x = F.max_pool2d(F.relu(self.conv1(x)), 2)
        x = F.max_pool2d(F.relu(self.conv2(x)), 2)
        x = F.relu(self.hidden1(x.flatten(1)))
        return self.logits(F.relu(self.hidden2(x)))  # type: ignore[no-any-return]
