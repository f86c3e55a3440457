"""Push-pull layers against the convolution, and against the equations carried out one by one with two convolutions."""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from benchmarks.push_pull_timing import fastest, forward_pass, training_step
from sextant.layers import PushPullAvgConv2d, PushPullAvgInhibition, PushPullConv2d, PushPullInhibition
from sextant.models.resnet_cifar import ResNetCifar

Row = tuple[str, str, str, str, str]


class TwoConvolutions(nn.Module):
    """The layer of 2020 as its equation reads, with h = 2 and α = 1."""

    def __init__(self, conv: nn.Conv2d):
        super().__init__()
        self.conv, side = conv, conv.kernel_size[0]
        self.wide = 2 * side + 1
        self.padding = self.wide // 2 - side // 2 + int(conv.padding[0])

    def forward(self, x: Tensor) -> Tensor:
        wide = F.interpolate(self.conv.weight, size=(self.wide, self.wide), mode="bilinear", align_corners=True)
        pull = F.conv2d(x, -wide, None if self.conv.bias is None else -self.conv.bias, self.conv.stride, self.padding)
        return F.relu(self.conv(x)) - 1.0 * F.relu(pull)


class TwoConvolutionsAveraged(nn.Module):
    """The layer of 2024 as its equation reads, with α = 1."""

    def __init__(self, conv: nn.Conv2d, average: int):
        super().__init__()
        self.conv, self.average = conv, average

    def forward(self, x: Tensor) -> Tensor:
        weight = self.conv.weight
        inverted = -weight + (weight.amax((1, 2, 3), keepdim=True) + weight.amin((1, 2, 3), keepdim=True))
        push = F.conv2d(x, weight, None, self.conv.stride, self.conv.padding)
        pull = F.conv2d(x, inverted, None, self.conv.stride, self.conv.padding)
        if self.average > 1:
            pull = F.avg_pool2d(pull, self.average, 1, self.average // 2, count_include_pad=False)
        return F.relu(push) - 1.0 * F.relu(pull)


def run() -> list[Row]:
    torch.set_num_threads(1)
    torch.manual_seed(0)
    return [*first_layer(), *inner_layer(), *averaged_layer(1), *averaged_layer(3), *network()]


def first_layer() -> list[Row]:
    conv = nn.Conv2d(3, 16, 3, padding=1, bias=False)
    layers = {"conv": conv, "ours": PushPullConv2d.from_conv(conv), "two": TwoConvolutions(conv)}
    images = torch.randn(128, 3, 32, 32)
    impl = layers["ours"].implementation(32, 32)  # type: ignore[operator]
    forward = fastest({name: forward_pass(layer, images) for name, layer in layers.items()})
    step = fastest({name: training_step(layer, images) for name, layer in layers.items()})
    name = f"push-pull 3 to 16, 3x3, 32x32, batch 128 ({impl})"
    return [
        row(f"{name}, forward", forward["ours"], "convolution", forward["conv"], "≤ 3.0"),
        row("the same", forward["ours"], "two convolutions", forward["two"], "≤ 0.6"),
        row(f"{name}, training step", step["ours"], "convolution", step["conv"], ""),
        row("the same", step["ours"], "two convolutions", step["two"], ""),
    ]


def inner_layer() -> list[Row]:
    """Where stretched kernels have many channels, as with inhibition in the whole network."""
    conv = nn.Conv2d(128, 128, 3, padding=1, bias=False)
    layers = {"conv": conv, "ours": PushPullConv2d.from_conv(conv), "two": TwoConvolutions(conv)}
    images = torch.randn(2, 128, 28, 28, requires_grad=True)
    impl = layers["ours"].implementation(28, 28)  # type: ignore[operator]
    seconds = fastest({name: training_step(layer, images) for name, layer in layers.items()}, repeats=5)
    name = f"push-pull 128 to 128, 3x3, 28x28, batch 2 ({impl}), training step"
    return [
        row(name, seconds["ours"], "convolution", seconds["conv"], ""),
        row("the same", seconds["ours"], "two convolutions", seconds["two"], "≤ 0.6"),
    ]


def averaged_layer(average: int) -> list[Row]:
    conv = nn.Conv2d(3, 64, 7, 2, 3, bias=False)
    layers = {
        "conv": conv,
        "ours": PushPullAvgConv2d.from_conv(conv, average=average),
        "two": TwoConvolutionsAveraged(conv, average),
    }
    images = torch.randn(4, 3, 224, 224)
    seconds = fastest({name: forward_pass(layer, images) for name, layer in layers.items()})
    name = f"push-pull of 2024, 3 to 64, 7x7/2, 224x224, average {average}, forward"
    return [
        row(name, seconds["ours"], "convolution", seconds["conv"], "≤ 1.25"),
        row("the same", seconds["ours"], "two convolutions", seconds["two"], "≤ 0.67"),
    ]


def network() -> list[Row]:
    nets = {
        "plain": ResNetCifar(3, (32, 32), 10),
        "push-pull": PushPullInhibition()(ResNetCifar(3, (32, 32), 10)),
        "push-pull of 2024": PushPullAvgInhibition()(ResNetCifar(3, (32, 32), 10)),
    }
    images = torch.randn(32, 3, 32, 32)
    forward = fastest({name: forward_pass(net.eval(), images) for name, net in nets.items()}, repeats=5)
    step = fastest({name: training_step(net.train(), images) for name, net in nets.items()}, repeats=5)
    return [
        row(f"ResNet-20 with a {name} first layer, {what}", times[name], "without", times["plain"], aim)
        for name, what, times, aim in (
            ("push-pull", "evaluation", forward, "≤ 1.08"),
            ("push-pull", "training step", step, "≤ 1.12"),
            ("push-pull of 2024", "evaluation", forward, ""),
            ("push-pull of 2024", "training step", step, ""),
        )
    ]


def row(name: str, ours: float, other: str, theirs: float, aim: str) -> Row:
    return (name, f"{1000 * ours:.2f} ms", f"{other}, {1000 * theirs:.2f} ms", f"{ours / theirs:.2f}", aim)
