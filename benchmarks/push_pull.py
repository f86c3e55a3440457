"""Push-pull layers against the convolution, and against a literal implementation with two convolutions.

Each case has its own process, since the time of a convolution depends on earlier memory use. Tasks alternate; ratios
are medians over turns.
"""

from itertools import product
from multiprocessing import get_context
from statistics import median

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from benchmarks.push_pull_timing import forward_pass, settle_allocator, training_step, turns
from sextant.layers import PushPullAvgConv2d, PushPullAvgInhibition, PushPullConv2d, PushPullInhibition
from sextant.models.resnet_cifar import ResNetCifar

Row = tuple[str, str, str, str, str]
Case = tuple[tuple[int, int, int, int, int], int, str]  # channels in and out, kernel, stride, image; batch; mode

SHAPES = [(3, 16, 3, 1, 32), (3, 64, 7, 2, 224), (64, 64, 3, 1, 56), (128, 128, 3, 1, 28)]
FORMS = ("direct", "rows", "factorised")
MODES = {"evaluation": forward_pass, "training": training_step}
REPEATS = 5


class TwoConvolutions(nn.Module):
    """The layer of 2020 literally by its equation, with h = 2 and α = 1."""

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
    """The layer of 2024 literally by its equation, with α = 1."""

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
    cases = list(product(SHAPES, (1, 8, 128), MODES))
    averaged = list(product(SHAPES[1:2], (8,), MODES))
    with get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        tables = [
            pool.map(measure, given, chunksize=1)
            for measure, given in ((stretched, cases), (inverted, averaged), (network, MODES))
        ]
    return [row for table in tables for rows in table for row in rows]


def stretched(case: Case) -> list[Row]:
    """The layer of 2020: the choice of ``auto`` against the convolution, two convolutions and the fastest form."""
    conv, images = convolution(case)
    forms = {impl: PushPullConv2d.from_conv(conv, impl=impl) for impl in FORMS}
    taken = PushPullConv2d.from_conv(conv).implementation(*images.shape[-2:])
    layers = {"convolution": conv, "two convolutions": TwoConvolutions(conv), **forms}
    seconds = turns({name: MODES[case[2]](layer, images) for name, layer in layers.items()}, REPEATS)
    best = min(FORMS, key=lambda impl: median(seconds[impl]))
    first, small = case[0] == SHAPES[1] and case[1:] == (8, "evaluation"), case[0] == SHAPES[0] and case[1] == 128
    name = f"push-pull {described(case)} ({taken})"
    return [
        row(name, seconds, taken, "convolution", "≤ 2.5" if first else ""),
        row("the same", seconds, taken, "two convolutions", "≤ 0.6" if small else ""),
        row(f"the same, fastest form {best}", seconds, taken, best, "≤ 1.05"),
    ]


def inverted(case: Case) -> list[Row]:
    """The layer of 2024."""
    rows = []
    for average in (1, 3):
        conv, images = convolution(case)
        ours = PushPullAvgConv2d.from_conv(conv, average=average)
        layers = {"convolution": conv, "two convolutions": TwoConvolutionsAveraged(conv, average), "ours": ours}
        seconds = turns({name: MODES[case[2]](layer, images) for name, layer in layers.items()}, REPEATS)
        name, aim = f"push-pull of 2024, average {average}, {described(case)}", "≤ 1.25" if average == 1 else ""
        rows += [
            row(name, seconds, "ours", "convolution", aim),
            row("the same", seconds, "ours", "two convolutions", "≤ 0.67"),
        ]
    return rows


def network(mode: str) -> list[Row]:
    torch.set_num_threads(1)
    torch.manual_seed(0)
    settle_allocator()
    nets = {
        "without": ResNetCifar(3, (32, 32), 10),
        "push-pull": PushPullInhibition()(ResNetCifar(3, (32, 32), 10)),
        "push-pull of 2024": PushPullAvgInhibition()(ResNetCifar(3, (32, 32), 10)),
    }
    images = torch.randn(32, 3, 32, 32)
    for net in nets.values():
        net.train(mode == "training")
    seconds = turns({name: MODES[mode](net, images) for name, net in nets.items()}, REPEATS)
    aims = {"evaluation": "≤ 1.08", "training": "≤ 1.12"}
    return [
        row(f"ResNet-20 with a {name} first layer, {mode}", seconds, name, "without", aim)
        for name, aim in (("push-pull", aims[mode]), ("push-pull of 2024", ""))
    ]


def convolution(case: Case) -> tuple[nn.Conv2d, Tensor]:
    torch.set_num_threads(1)
    torch.manual_seed(0)
    settle_allocator()
    (in_channels, out_channels, kernel, stride, size), batch, _ = case
    images = torch.randn(batch, in_channels, size, size)
    images.requires_grad_(in_channels > 3)  # a first layer needs no input gradient
    return nn.Conv2d(in_channels, out_channels, kernel, stride, kernel // 2, bias=False), images


def described(case: Case) -> str:
    (in_channels, out_channels, kernel, stride, size), batch, mode = case
    step = f"/{stride}" if stride > 1 else ""
    return f"{in_channels} to {out_channels}, {kernel}x{kernel}{step}, {size}x{size}, batch {batch}, {mode}"


def row(name: str, seconds: dict[str, list[float]], ours: str, other: str, aim: str) -> Row:
    ratios = [a / b for a, b in zip(seconds[ours], seconds[other], strict=True)]
    ratio = f"{median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})"
    times = {work: f"{1000 * median(seconds[work]):.3g} ms" for work in (ours, other)}
    return (name, times[ours], f"{other}, {times[other]}", ratio, aim)
