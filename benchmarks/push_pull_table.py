"""Time the implementations of the pull response and write the table that ``impl="auto"`` reads.

``python -m benchmarks.push_pull_table`` replaces ``src/sextant/layers/pull_timings.json``. Runs whose layers
then use another implementation change by rounding, so the table is written once and kept.
"""

import json
from importlib.resources import files

import torch
from torch import nn

from benchmarks.machine import describe_machine
from benchmarks.push_pull_timing import fastest, forward_pass, settle_allocator, training_step
from sextant.layers import PushPullConv2d, pull_kernel_size
from sextant.layers.implementation import TABLE

IMPLEMENTATIONS = ("direct", "rows", "factorised")
COLUMNS = ("kernel", "scale", "stride", "size", "in_channels", "out_channels", "groups")  # channels of one group
SHAPES = [
    # first layers: networks for small images, ResNet, MobileNet, VGG, AlexNet, LeNet
    (3, 2.0, 1, 32, 3, 16, 1),
    (3, 1.5, 1, 32, 3, 16, 1),
    (3, 2.0, 1, 32, 3, 64, 1),
    (7, 2.0, 2, 224, 3, 64, 1),
    (7, 1.5, 2, 224, 3, 64, 1),
    (7, 2.0, 2, 96, 3, 64, 1),
    (3, 2.0, 2, 224, 3, 32, 1),
    (3, 2.0, 1, 224, 3, 64, 1),
    (11, 2.0, 4, 224, 3, 64, 1),
    (5, 2.0, 1, 28, 1, 6, 1),
    (5, 1.5, 1, 28, 1, 6, 1),
    # inner layers: LeNet, AlexNet, ResNets for CIFAR and ImageNet, DenseNets
    (5, 2.0, 1, 14, 6, 16, 1),
    (5, 2.0, 1, 27, 64, 192, 1),
    (3, 2.0, 1, 32, 16, 16, 1),
    (3, 1.5, 1, 32, 16, 16, 1),
    (3, 2.0, 1, 16, 32, 32, 1),
    (3, 2.0, 1, 8, 64, 64, 1),
    (3, 2.0, 1, 56, 64, 64, 1),
    (3, 1.5, 1, 56, 64, 64, 1),
    (3, 2.0, 2, 56, 128, 128, 1),
    (3, 2.0, 1, 28, 128, 128, 1),
    (3, 2.0, 1, 14, 256, 256, 1),
    (3, 1.5, 1, 14, 256, 256, 1),
    (3, 2.0, 1, 7, 512, 512, 1),
    (3, 2.0, 1, 32, 48, 12, 1),
    (3, 2.0, 1, 56, 128, 32, 1),
    # groups: ResNeXt, MobileNet, ConvNeXt
    (3, 2.0, 1, 56, 4, 4, 32),
    (3, 2.0, 1, 56, 1, 1, 64),
    (3, 2.0, 1, 14, 1, 1, 384),
    (7, 2.0, 1, 28, 1, 1, 96),
]
PRODUCTS = 2e7  # of the push convolution in one step, at least: enough that Python's share is small


def measure(
    kernel: int, scale: float, stride: int, size: int, in_channels: int, out_channels: int, groups: int
) -> dict[str, object]:
    channels = (in_channels * groups, out_channels * groups)
    products = (size // stride) ** 2 * kernel**2 * in_channels * channels[1]
    if in_channels == 1 < groups:
        products *= 4  # convolutions of single channels run far below the speed of others
    images = torch.randn(min(64, max(8, round(PRODUCTS / products))), channels[0], size, size)
    images.requires_grad_(in_channels * groups > 3)  # a first layer needs no input gradient
    conv = nn.Conv2d(*channels, kernel, stride, kernel // 2, groups=groups)
    layers = {impl: PushPullConv2d.from_conv(conv, scale=scale, impl=impl) for impl in IMPLEMENTATIONS}
    tasks = {"evaluation": forward_pass, "training": training_step}
    seconds = {
        name: fastest({impl: task(layer, images) for impl, layer in layers.items()}) for name, task in tasks.items()
    }
    return {
        "kernel": kernel,
        "pull": pull_kernel_size(kernel, scale),
        "stride": stride,
        "size": size,
        "in_channels": in_channels,
        "out_channels": out_channels,
        "groups": groups,
        **{name: milliseconds(times) for name, times in seconds.items()},
    }


def milliseconds(seconds: dict[str, float]) -> dict[str, float]:
    return {impl: float(f"{1000 * time:.3g}") for impl, time in seconds.items()}


def main() -> None:
    torch.set_num_threads(1)
    torch.manual_seed(0)
    settle_allocator()
    rows = [json.dumps(measure(*shape)) for shape in SHAPES]
    measured = {
        "command": "python -m benchmarks.push_pull_table",
        "machine": describe_machine(),
        "what": "milliseconds of one layer, forward, and forward and backward; one thread, the process's own time, "
        "fastest of nine",
    }
    head = "".join(f'  "{key}": {json.dumps(value)},\n' for key, value in measured.items())
    text = "{\n" + head + '  "rows": [\n    ' + ",\n    ".join(rows) + "\n  ]\n}\n"
    path = files("sextant.layers").joinpath(TABLE)
    with open(str(path), "w") as file:
        file.write(text)
    print(text)


if __name__ == "__main__":
    main()
