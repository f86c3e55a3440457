"""AlexNet for images of 32x32 pixels, the baseline that the corruption errors of other networks are divided by.

The push-pull paper states that all kernels of this network are 3x3, that the first convolution has stride 2, and that
1024 numbers enter the fully connected layers. Widths, pooling, hidden layers and dropout are not published; AlexNet's
own widths with three 2x2 poolings give 256 x 2 x 2 = 1024. No weights are published either: the paper's *errors* are in
:mod:`sextant.evaluation.corruption_errors`.

Sources: A. Krizhevsky et al., "ImageNet classification with deep convolutional neural networks", 2012, with the widths
of A. Krizhevsky, "One weird trick for parallelizing convolutional neural networks", 2014; Strisciuglio et al.,
"Enhanced robustness of convolutional networks with a push-pull inhibition layer", 2020, appendix 2.
"""

from collections.abc import Sequence

from jaxtyping import Float
from torch import Tensor, nn

from sextant.models.standardize import Standardize


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

    def __init__(
        self,
        in_channels: int,
        image_size: tuple[int, int],
        num_classes: int,
        *,
        hidden: int = 4096,
        dropout: float = 0.5,
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
