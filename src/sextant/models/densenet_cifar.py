"""Densely connected networks with bottlenecks and compression (DenseNet-BC) for small images.

Sources: G. Huang et al., "Densely connected convolutional networks", CVPR 2017; 24 channels after the first convolution
for every growth rate, as in Strisciuglio et al. 2020. Layers are named as in torchvision's DenseNet.
"""

from collections import OrderedDict
from collections.abc import Sequence
from typing import Annotated

import torch
import torch.nn.functional as F
from annotated_types import Ge, Le
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import ArgumentError
from sextant.models.resnet_cifar import he_normal
from sextant.models.standardize import Standardize
from sextant.ranges import Count, checked

FIRST_WIDTH = 24
BOTTLENECK = 4


class DenseLayer(nn.Module):
    r"""Appends ``growth`` channels to its input: :math:`[x, W_2 * \Theta(N_2(W_1 * \Theta(N_1(x))))]`.

    :math:`W_1` is 1x1 to ``4 growth`` channels, :math:`W_2` is 3x3, N batch normalisation and Θ the ReLU.
    """

    def __init__(self, before: int, growth: int):
        super().__init__()
        self.norm1 = nn.BatchNorm2d(before)
        self.conv1 = nn.Conv2d(before, BOTTLENECK * growth, 1, bias=False)
        self.norm2 = nn.BatchNorm2d(BOTTLENECK * growth)
        self.conv2 = nn.Conv2d(BOTTLENECK * growth, growth, 3, padding=1, bias=False)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d h w"]:
        """The input's channels, then the new ones."""
        y = self.conv1(F.relu(self.norm1(x)))
        return torch.cat([x, self.conv2(F.relu(self.norm2(y)))], 1)


class Transition(nn.Module):
    """Halves the channels with a 1x1 convolution and the sides with 2x2 mean pooling."""

    def __init__(self, before: int, width: int):
        super().__init__()
        self.norm = nn.BatchNorm2d(before)
        self.conv = nn.Conv2d(before, width, 1, bias=False)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d h2 w2"]:
        """Fewer and smaller feature maps."""
        return F.avg_pool2d(self.conv(F.relu(self.norm(x))), 2)


class DenseNetCifar(nn.Module):
    """A 3x3 convolution, three dense blocks of (depth - 4) / 6 layers with transitions, the mean, a linear layer.

    The paper's networks are 40-12, 100-12 and 100-24 (depth-growth).

    Args:
        in_channels: channels of the image.
        image_size: height and width of the image in pixels, at least 4 each.
        num_classes: number of logits.
        depth: layers with weights; 4 more than a multiple of 6.
        growth: channels that each dense layer adds.
        mean, std: statistics of the training images by channel; by default those of CIFAR-10 for three channels.

    Raises:
        ValueError: there is no such depth, the growth is not positive, or the image is too small.

    Example:
        >>> sum(parameter.numel() for parameter in DenseNetCifar(3, (32, 32), 10, depth=40, growth=12).parameters())
        176122
    """

    @checked
    def __init__(
        self,
        in_channels: int,
        image_size: tuple[int, int],
        num_classes: int,
        *,
        depth: Annotated[int, Ge(10), Le(1000)] = 40,
        growth: Count = 12,
        mean: Sequence[float] | None = None,
        std: Sequence[float] | None = None,
    ):
        super().__init__()
        if (depth - 4) % 6:
            raise ArgumentError(f"depth={depth} must be 6 n + 4, for example 40 or 100")
        if min(image_size) < 4:
            raise ValueError(f"DenseNet needs images of at least 4x4 pixels, got {image_size[0]}x{image_size[1]}")
        layers = (depth - 4) // 6
        self.standardize = Standardize(in_channels, mean, std)
        features: OrderedDict[str, nn.Module] = OrderedDict()
        features["conv0"] = nn.Conv2d(in_channels, FIRST_WIDTH, 3, padding=1, bias=False)
        width = FIRST_WIDTH
        for number in (1, 2, 3):
            features[f"denseblock{number}"] = _dense_block(width, layers, growth)
            width += layers * growth
            if number < 3:
                features[f"transition{number}"] = Transition(width, width // 2)
                width //= 2
        features["norm_final"] = nn.BatchNorm2d(width)
        self.features = nn.Sequential(features)
        self.classifier = nn.Linear(width, num_classes)
        he_normal(self)
        nn.init.zeros_(self.classifier.bias)
        self.to(memory_format=torch.channels_last)  # faster on CPUs

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Class logits of a batch of images in [0, 1]."""
        x = F.relu(self.features(self.standardize(x).contiguous(memory_format=torch.channels_last)))
        return self.classifier(x.mean((2, 3)))  # type: ignore[no-any-return]


def _dense_block(before: int, layers: int, growth: int) -> nn.Sequential:
    return nn.Sequential(
        OrderedDict((f"denselayer{i + 1}", DenseLayer(before + i * growth, growth)) for i in range(layers))
    )
