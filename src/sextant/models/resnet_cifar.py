"""Residual networks for small images, 20 to 56 layers deep.

Sources: K. He et al., "Deep residual learning for image recognition", CVPR 2016, section 4.2; with 1x1 convolutions on
the shortcuts that change shape, where He et al. pad with zeros, as in Strisciuglio et al. 2020. Layers are named as in
torchvision's ResNet.
"""

from collections.abc import Sequence
from typing import Annotated

import torch
import torch.nn.functional as F
from annotated_types import Ge, Le
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import ArgumentError
from sextant.models.standardize import Standardize
from sextant.ranges import checked

WIDTHS = (16, 32, 64)


class BasicBlock(nn.Module):
    r"""Two 3x3 convolutions with batch normalisation, added to the input: :math:`\Theta(F(x) + S(x))`, Θ the ReLU.

    S is the identity, or a 1x1 convolution with batch normalisation where F changes the shape.
    """

    def __init__(self, before: int, width: int, stride: int):
        super().__init__()
        self.conv1 = nn.Conv2d(before, width, 3, stride, padding=1, bias=False)
        self.bn1 = nn.BatchNorm2d(width)
        self.conv2 = nn.Conv2d(width, width, 3, padding=1, bias=False)
        self.bn2 = nn.BatchNorm2d(width)
        self.downsample: nn.Sequential | None = None
        if stride != 1 or before != width:
            self.downsample = nn.Sequential(nn.Conv2d(before, width, 1, stride, bias=False), nn.BatchNorm2d(width))

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d h2 w2"]:
        """Features, at half the sides with stride 2."""
        y = F.relu(self.bn1(self.conv1(x)))
        shortcut = x if self.downsample is None else self.downsample(x)
        return F.relu(self.bn2(self.conv2(y)) + shortcut)


class ResNetCifar(nn.Module):
    """A 3x3 convolution, three stages of (depth - 2) / 6 blocks with 16, 32 and 64 channels, the mean, a linear layer.

    Args:
        in_channels: channels of the image.
        image_size: height and width of the image in pixels, at least 4 each.
        num_classes: number of logits.
        depth: layers with weights on the longest path, 6 n + 2: the paper's are 20, 32, 44 and 56.
        mean, std: statistics of the training images by channel; by default those of CIFAR-10 for three channels.

    Raises:
        ValueError: the depth is not 6 n + 2 or the image is too small.

    Example:
        >>> sum(parameter.numel() for parameter in ResNetCifar(3, (32, 32), 10, depth=20).parameters())  # 0.27 million
        272474
    """

    @checked
    def __init__(
        self,
        in_channels: int,
        image_size: tuple[int, int],
        num_classes: int,
        *,
        depth: Annotated[int, Ge(8), Le(1202)] = 20,
        mean: Sequence[float] | None = None,
        std: Sequence[float] | None = None,
    ):
        super().__init__()
        if (depth - 2) % 6:
            raise ArgumentError(f"depth={depth} must be 6 n + 2, for example 20, 32, 44 or 56")
        if min(image_size) < 4:
            raise ValueError(f"ResNet needs images of at least 4x4 pixels, got {image_size[0]}x{image_size[1]}")
        blocks = (depth - 2) // 6
        self.standardize = Standardize(in_channels, mean, std)
        self.conv1 = nn.Conv2d(in_channels, WIDTHS[0], 3, padding=1, bias=False)
        self.bn1 = nn.BatchNorm2d(WIDTHS[0])
        self.layer1 = _stage(WIDTHS[0], WIDTHS[0], blocks, stride=1)
        self.layer2 = _stage(WIDTHS[0], WIDTHS[1], blocks, stride=2)
        self.layer3 = _stage(WIDTHS[1], WIDTHS[2], blocks, stride=2)
        self.fc = nn.Linear(WIDTHS[2], num_classes)
        he_normal(self)
        self.to(memory_format=torch.channels_last)  # a quarter less time on CPUs

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Class logits of a batch of images in [0, 1]."""
        x = self.standardize(x).contiguous(memory_format=torch.channels_last)
        x = F.relu(self.bn1(self.conv1(x)))
        x = self.layer3(self.layer2(self.layer1(x)))
        return self.fc(x.mean((2, 3)))  # type: ignore[no-any-return]


def _stage(before: int, width: int, blocks: int, stride: int) -> nn.Sequential:
    return nn.Sequential(BasicBlock(before, width, stride), *(BasicBlock(width, width, 1) for _ in range(blocks - 1)))


def he_normal(network: nn.Module) -> None:
    r"""Draw the weights of all convolutions from :math:`N(0, 2 / (k_h k_w C_\mathrm{out}))`, He's rule on the fan-out.

    Source: K. He et al., "Delving deep into rectifiers", ICCV 2015.
    """
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")
