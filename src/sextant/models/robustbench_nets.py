r"""Networks for CIFAR in the layout of RobustBench's files: Wide ResNet, ResNeXt and ResNet-18.

Layers are named as there, so that a state dict fits. Images in [0, 1] are standardised first.

Sources: S. Zagoruyko, N. Komodakis, "Wide residual networks", BMVC 2016; S. Xie et al., "Aggregated residual
transformations for deep neural networks", CVPR 2017; K. He et al., CVPR 2016. Names: RobustBench,
``model_zoo/architectures``.
"""

from collections.abc import Sequence
from typing import Annotated, Literal

import torch.nn.functional as F
from annotated_types import Ge, Le
from jaxtyping import Float
from torch import Tensor, nn

from sextant.models.resnet_cifar import he_normal
from sextant.models.standardize import Standardize
from sextant.ranges import Count, Positive, checked

Kind = Literal["wide_resnet", "resnext", "resnet18"]


@checked
def robustbench_net(
    in_channels: int,
    image_size: tuple[int, int],
    num_classes: int,
    *,
    kind: Kind = "wide_resnet",
    depth: Annotated[int, Ge(10), Le(1000)] = 28,
    width: Count = 10,
    groups: Count = 1,
    mean: Sequence[float] | None = None,
    std: Sequence[Positive] | None = None,
) -> nn.Module:
    """A network of one of these kinds, with new weights.

    Args:
        in_channels: channels of the image.
        image_size: height and width, at least 8 each.
        num_classes: number of logits.
        kind: ``wide_resnet``, ``resnext`` or ``resnet18``.
        depth: 6 n + 4 of a Wide ResNet, 9 n + 2 of a ResNeXt.
        width: factor on the widths of a Wide ResNet; channels of one group in the first stage of a ResNeXt.
        groups: groups of the 3x3 convolutions of a ResNeXt.
        mean, std: by channel; null for those of CIFAR-10.

    Raises:
        ValueError: there is no such depth, or the image is too small.

    Example:
        >>> network = robustbench_net(3, (32, 32), 10, depth=28, width=10)
        >>> sum(p.numel() for p in network.parameters())  # 36.5 million, table 4 of the paper
        36479194
    """
    if min(image_size) < 8:
        raise ValueError(f"images of at least 8x8 pixels are needed, got {image_size[0]}x{image_size[1]}")
    step, rest = {"wide_resnet": (6, 4), "resnext": (9, 2), "resnet18": (1, 18)}[kind]
    if (depth - rest) % step or depth <= rest - (kind == "resnet18"):
        raise ValueError(f"depth={depth} must be {step} n + {rest}" if step > 1 else f"depth={depth} must be {rest}")
    if kind == "wide_resnet":
        network: nn.Module = WideResNet(in_channels, num_classes, (depth - 4) // 6, width)
    elif kind == "resnext":
        network = ResNeXt(in_channels, num_classes, (depth - 2) // 9, width, groups)
    else:
        network = ResNet18(in_channels, num_classes)
    he_normal(network)
    network.standardize = Standardize(in_channels, mean, std)
    return network


class _PreActivated(nn.Module):
    """Two 3x3 convolutions, each after normalisation and ReLU; the shortcut is a 1x1 convolution if widths differ."""

    def __init__(self, before: int, width: int, stride: int):
        super().__init__()
        self.bn1 = nn.BatchNorm2d(before)
        self.conv1 = nn.Conv2d(before, width, 3, stride, padding=1, bias=False)
        self.bn2 = nn.BatchNorm2d(width)
        self.conv2 = nn.Conv2d(width, width, 3, padding=1, bias=False)
        self.convShortcut = None if before == width else nn.Conv2d(before, width, 1, stride, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        active = F.relu(self.bn1(x))
        shortcut = x if self.convShortcut is None else self.convShortcut(active)
        return shortcut + self.conv2(F.relu(self.bn2(self.conv1(active))))  # type: ignore[no-any-return]


class _Stage(nn.Module):
    """Blocks of one width."""

    def __init__(self, before: int, width: int, blocks: int, stride: int):
        super().__init__()
        rest = (_PreActivated(width, width, 1) for _ in range(blocks - 1))
        self.layer = nn.Sequential(_PreActivated(before, width, stride), *rest)

    def forward(self, x: Tensor) -> Tensor:
        return self.layer(x)  # type: ignore[no-any-return]


class WideResNet(nn.Module):
    """WRN-(6 n + 4)-k: 3 stages of n blocks with 16 k, 32 k and 64 k channels."""

    standardize: nn.Module

    def __init__(self, in_channels: int, num_classes: int, blocks: int, factor: int):
        super().__init__()
        widths = (16, 16 * factor, 32 * factor, 64 * factor)
        self.conv1 = nn.Conv2d(in_channels, widths[0], 3, padding=1, bias=False)
        self.block1 = _Stage(widths[0], widths[1], blocks, 1)
        self.block2 = _Stage(widths[1], widths[2], blocks, 2)
        self.block3 = _Stage(widths[2], widths[3], blocks, 2)
        self.bn1 = nn.BatchNorm2d(widths[-1])
        self.fc = nn.Linear(widths[-1], num_classes)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Class logits of images in [0, 1]."""
        x = self.block3(self.block2(self.block1(self.conv1(self.standardize(x)))))
        return self.fc(F.relu(self.bn1(x)).mean((2, 3)))  # type: ignore[no-any-return]


class _Aggregated(nn.Module):
    """A bottleneck whose 3x3 convolution is grouped."""

    def __init__(self, before: int, inner: int, after: int, groups: int, stride: int):
        super().__init__()
        self.conv_reduce, self.bn_reduce = nn.Conv2d(before, inner, 1, bias=False), nn.BatchNorm2d(inner)
        self.conv_conv = nn.Conv2d(inner, inner, 3, stride, padding=1, groups=groups, bias=False)
        self.bn = nn.BatchNorm2d(inner)
        self.conv_expand, self.bn_expand = nn.Conv2d(inner, after, 1, bias=False), nn.BatchNorm2d(after)
        shortcut = nn.Sequential(nn.Conv2d(before, after, 1, stride, bias=False), nn.BatchNorm2d(after))
        self.downsample = None if stride == 1 and before == after else shortcut

    def forward(self, x: Tensor) -> Tensor:
        y = F.relu(self.bn(self.conv_conv(F.relu(self.bn_reduce(self.conv_reduce(x))))))
        return F.relu(self.bn_expand(self.conv_expand(y)) + (x if self.downsample is None else self.downsample(x)))


def _aggregated(before: int, after: int, blocks: int, width: int, groups: int, stride: int) -> nn.Sequential:
    inner = after // 4 * width // 64 * groups
    rest = (_Aggregated(after, inner, after, groups, 1) for _ in range(blocks - 1))
    return nn.Sequential(_Aggregated(before, inner, after, groups, stride), *rest)


class ResNeXt(nn.Module):
    """ResNeXt-(9 n + 2): 3 stages of n bottlenecks with 256, 512 and 1024 channels."""

    standardize: nn.Module

    def __init__(self, in_channels: int, num_classes: int, blocks: int, width: int, groups: int):
        super().__init__()
        self.conv_1_3x3 = nn.Conv2d(in_channels, 64, 3, padding=1, bias=False)
        self.bn_1 = nn.BatchNorm2d(64)
        self.stage_1 = _aggregated(64, 256, blocks, width, groups, 1)
        self.stage_2 = _aggregated(256, 512, blocks, width, groups, 2)
        self.stage_3 = _aggregated(512, 1024, blocks, width, groups, 2)
        self.classifier = nn.Linear(1024, num_classes)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Class logits of images in [0, 1]."""
        x = F.relu(self.bn_1(self.conv_1_3x3(self.standardize(x))))
        return self.classifier(self.stage_3(self.stage_2(self.stage_1(x))).mean((2, 3)))  # type: ignore[no-any-return]


class _Basic(nn.Module):
    """Two 3x3 convolutions, each before normalisation."""

    def __init__(self, before: int, width: int, stride: int):
        super().__init__()
        self.conv1 = nn.Conv2d(before, width, 3, stride, padding=1, bias=False)
        self.bn1 = nn.BatchNorm2d(width)
        self.conv2 = nn.Conv2d(width, width, 3, padding=1, bias=False)
        self.bn2 = nn.BatchNorm2d(width)
        self.shortcut = nn.Sequential()
        if stride != 1 or before != width:
            self.shortcut = nn.Sequential(nn.Conv2d(before, width, 1, stride, bias=False), nn.BatchNorm2d(width))

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(self.bn2(self.conv2(F.relu(self.bn1(self.conv1(x))))) + self.shortcut(x))


class ResNet18(nn.Module):
    """ResNet-18 with a 3x3 stem of stride 1: 4 stages of 2 blocks with 64 to 512 channels."""

    standardize: nn.Module

    def __init__(self, in_channels: int, num_classes: int):
        super().__init__()
        self.conv1, self.bn1 = nn.Conv2d(in_channels, 64, 3, padding=1, bias=False), nn.BatchNorm2d(64)
        self.layer1 = nn.Sequential(_Basic(64, 64, 1), _Basic(64, 64, 1))
        self.layer2 = nn.Sequential(_Basic(64, 128, 2), _Basic(128, 128, 1))
        self.layer3 = nn.Sequential(_Basic(128, 256, 2), _Basic(256, 256, 1))
        self.layer4 = nn.Sequential(_Basic(256, 512, 2), _Basic(512, 512, 1))
        self.linear = nn.Linear(512, num_classes)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Class logits of images in [0, 1]."""
        x = F.relu(self.bn1(self.conv1(self.standardize(x))))
        x = self.layer4(self.layer3(self.layer2(self.layer1(x))))
        return self.linear(x.mean((2, 3)))  # type: ignore[no-any-return]
