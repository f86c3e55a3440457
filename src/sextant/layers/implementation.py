"""The choice of a layer's pull implementation: a fixed rule on its shape, from a table of timings.

Rounding differs between implementations and training amplifies rounding, so nothing is timed while a network runs: the
same shape always gets the same implementation, on every machine. ``pull_timings.json`` holds the timings measured once
by ``python -m benchmarks.push_pull_table``.
"""

import json
import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from sextant.layers.pull_response import Implementation

TABLE = "pull_timings.json"
LEAST_GAIN = 0.05  # a smaller gain is within the spread of the timings, and ``direct`` is kept
Times = dict[Implementation, float]


@dataclass(frozen=True)
class PullShape:
    """The shape of a pull response, on which the rule decides.

    Args:
        kernel: sides of the push kernel.
        pull: sides of the stretched kernel.
        in_channels: input channels per group.
        out_channels: output channels per group.
        groups: number of groups.
        stride: stride of the convolution.
        size: height and width of the image.
    """

    kernel: tuple[int, int]
    pull: tuple[int, int]
    in_channels: int
    out_channels: int
    groups: int
    stride: tuple[int, int]
    size: tuple[int, int]

    def place(self) -> tuple[float, ...]:
        """The shape as a point: base-2 logarithms, with the geometric mean where there are two sides."""
        sides = (self.kernel, self.pull, self.stride, self.size)
        counts = (self.in_channels, self.out_channels, self.groups)
        return (*(math.log2(a * b) / 2 for a, b in sides), *(math.log2(count) for count in counts))


@cache
def choose_implementation(shape: PullShape) -> Implementation:
    """The implementation that was fastest, in evaluation and training, on the measured shape nearest to ``shape``.

    Distances are between the base-2 logarithms of kernel, pull kernel, stride, image side, channels per group and
    groups; of two equally near shapes, the table's first is used. The fastest is the one with the lowest geometric
    mean of both times, so that a network computes the same in training and afterwards. ``direct`` is kept unless
    another saves 5 %.
    """
    _, times = min(_table(), key=lambda row: math.dist(row[0].place(), shape.place()))
    best = min(times, key=lambda name: times[name])
    return best if times[best] <= (1 - LEAST_GAIN) * times["direct"] else "direct"


@cache
def _table() -> list[tuple[PullShape, Times]]:
    document = json.loads(files("sextant.layers").joinpath(TABLE).read_text())
    return [(shape_of(row), mean_times(row)) for row in document["rows"]]


def mean_times(row: dict[str, Any]) -> Times:
    """The geometric mean of a row's milliseconds in evaluation and training."""
    return {name: math.sqrt(time * row["training"][name]) for name, time in row["evaluation"].items()}


def shape_of(row: dict[str, Any]) -> PullShape:
    """The shape of a row of the table, whose kernels, strides and images are square."""
    square = {name: (row[name], row[name]) for name in ("kernel", "pull", "stride", "size")}
    counts = {name: row[name] for name in ("in_channels", "out_channels", "groups")}
    arguments: dict[str, Any] = square | counts
    return PullShape(**arguments)
