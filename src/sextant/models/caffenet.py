"""The convolutions of CaffeNet, the AlexNet that comes with Caffe, which can be cut off after any layer.

Lopez-Antequera et al. 2017 cut off a CaffeNet trained on objects within its convolutions and put one fully connected
layer on top; :class:`~sextant.models.FeatureMap` can cut it off, for example, after ``features.conv4``. We do not know
after which convolution they did. Unlike in A. Krizhevsky et al. 2012, pooling comes before local response
normalisation. For pretrained weights there is torchvision's ``alexnet``, a variant of 2014.

Source: Y. Jia et al., "Caffe: convolutional architecture for fast feature embedding", 2014, bvlc_reference_caffenet.
"""

from collections import OrderedDict

from jaxtyping import Float
from torch import Tensor, nn


def _pool() -> nn.MaxPool2d:
    return nn.MaxPool2d(3, 2, ceil_mode=True)  # Caffe rounds up


class CaffeNet(nn.Module):
    """Five convolutions with ReLU; ``features.conv1`` to ``features.pool5``.

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
