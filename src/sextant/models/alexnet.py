"""AlexNet for images of 32x32 pixels, the baseline that the corruption errors of other networks are divided by.

The push-pull paper states that all kernels of this network are 3x3, that the first convolution has stride 2, and that
1024 numbers enter the fully connected layers. Widths, pooling, hidden layers and dropout are not published; AlexNet's
own widths with three 2x2 poolings give 256 x 2 x 2 = 1024. No weights are published either: the paper's *errors* are in
:mod:`sextant.evaluation.corruption_errors`.

Sources: A. Krizhevsky et al., "ImageNet classification with deep convolutional neural networks", 2012, with the widths
of A. Krizhevsky, "One weird trick for parallelizing convolutional neural networks", 2014; Strisciuglio et al.,
"Enhanced robustness of convolutional networks with a push-pull inhibition layer", 2020, appendix 2.
"""

from collections import OrderedDict
from collections.abc import Sequence
from typing import Annotated

from annotated_types import Ge, Lt
from jaxtyping import Float
from torch import Tensor, nn

from sextant.models.standardize import Standardize
from sextant.ranges import Count, checked


class AlexNetCifar(nn.Module):
    """Five 3x3 convolutions with ReLU and three 2x2 max poolings, then three linear layers with dropout.

    Args:
        in_channels: channels of the image.
        image_size: height and width of the image in pixels, at least 15 each.
        num_classes: number of logits.
        hidden: units of the two hidden layers.
        dropout: share of the inputs of each hidden layer that training drops.
        mean, std: statistics of the training images by channel; by default those of CIFAR-10 for three channels.

    Raises:
        ValueError: the image is too small for the poolings, or ``dropout`` is not in [0, 1].

    Example:
        >>> import torch
        >>> AlexNetCifar(3, (32, 32), num_classes=10)(torch.rand(2, 3, 32, 32)).shape
        torch.Size([2, 10])
    """

    @checked
    def __init__(
        self,
        in_channels: int,
        image_size: tuple[int, int],
        num_classes: int,
        *,
        hidden: Count = 4096,
        dropout: Annotated[float, Ge(0), Lt(1)] = 0.5,
        mean: Sequence[float] | None = None,
        std: Sequence[float] | None = None,
    ):
        super().__init__()
        height, width = (((side + 1) // 2) // 8 for side in image_size)
        if min(height, width) < 1:
            raise ValueError(f"AlexNet needs images of at least 15x15 pixels, got {image_size[0]}x{image_size[1]}")
        self.standardize = Standardize(in_channels, mean, std)
        self.features = nn.Sequential(
            nn.Conv2d(in_channels, 64, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.MaxPool2d(2),
            nn.Conv2d(64, 192, 3, padding=1),
            nn.ReLU(),
            nn.MaxPool2d(2),
            nn.Conv2d(192, 384, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(384, 256, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(256, 256, 3, padding=1),
            nn.ReLU(),
            nn.MaxPool2d(2),
        )
        self.classifier = nn.Sequential(
            nn.Dropout(dropout),
            nn.Linear(256 * height * width, hidden),
            nn.ReLU(),
            nn.Dropout(dropout),
            nn.Linear(hidden, hidden),
            nn.ReLU(),
            nn.Linear(hidden, num_classes),
        )

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Class logits of a batch of images in [0, 1]."""
        return self.classifier(self.features(self.standardize(x)).flatten(1))  # type: ignore[no-any-return]


def _pool() -> nn.MaxPool2d:
    return nn.MaxPool2d(3, 2, ceil_mode=True)  # Caffe rounds up


class CaffeNet(nn.Module):
    """Five convolutions with ReLU; ``features.conv1`` to ``features.pool5``.

    Lopez-Antequera et al. 2017 cut off a CaffeNet trained on objects within its convolutions and put one fully
    connected layer on top; :class:`~sextant.models.FeatureMap` can cut it off, for example, after ``features.conv4``.
    We do not know after which convolution they did. Unlike in A. Krizhevsky et al. 2012, pooling comes before local
    response normalisation. For pretrained weights there is torchvision's ``alexnet``, a variant of 2014.

    Source: Y. Jia et al., "Caffe: convolutional architecture for fast feature embedding", 2014,
        bvlc_reference_caffenet.

    Args:
        in_channels: channels of the image.
        image_size: height and width of the image in pixels, at least 19 each, 39 for all of its layers;
            the original has 227.
        num_classes: outputs of a linear layer on the mean of the map.

    Raises:
        ValueError: the image is too small.

    Example:
        >>> import torch
        >>> CaffeNet(3, (227, 227), num_classes=10).features(torch.rand(1, 3, 227, 227)).shape  # pool5, as published
        torch.Size([1, 256, 6, 6])
    """

    def __init__(self, in_channels: int, image_size: tuple[int, int], num_classes: int):
        super().__init__()
        if min(image_size) < 19:
            raise ValueError(f"CaffeNet needs images of at least 19x19 pixels, got {image_size[0]}x{image_size[1]}")
        self.features = nn.Sequential(
            OrderedDict(
                conv1=nn.Sequential(nn.Conv2d(in_channels, 96, 11, 4), nn.ReLU()),
                pool1=nn.Sequential(_pool(), nn.LocalResponseNorm(5)),
                conv2=nn.Sequential(nn.Conv2d(96, 256, 5, padding=2, groups=2), nn.ReLU()),
                pool2=nn.Sequential(_pool(), nn.LocalResponseNorm(5)),
                conv3=nn.Sequential(nn.Conv2d(256, 384, 3, padding=1), nn.ReLU()),
                conv4=nn.Sequential(nn.Conv2d(384, 384, 3, padding=1, groups=2), nn.ReLU()),
                conv5=nn.Sequential(nn.Conv2d(384, 256, 3, padding=1, groups=2), nn.ReLU()),
                pool5=_pool(),
            )
        )
        self.head = nn.Linear(256, num_classes)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Outputs of the last layer for a batch of images."""
        return self.head(self.features(x).mean((2, 3)))  # type: ignore[no-any-return]
