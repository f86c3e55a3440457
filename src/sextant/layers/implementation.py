"""Which implementation of the pull response a layer takes: a fixed rule on its shape, from a table of timings.

Rounding differs between implementations and training amplifies rounding, so nothing is timed while a network runs: the
same shape takes the same implementation on every machine and every day. ``pull_timings.json`` holds what
``python -m benchmarks.push_pull_table`` measured once.
"""

import json
import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from sextant.layers.pull_response import Implementation

TABLE = "pull_timings.json"
LEAST_GAIN = 0.1  # a smaller one is within the spread of the timings: then it stays direct


@dataclass(frozen=True)
class PullShape:
    """What the rule looks at.

    Args:
        kernel: sides of the push kernel.
        pull: sides of the stretched kernel.
        in_channels: of one group.
        out_channels: of one group.
        groups: how many groups.
        stride: of the convolution.
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
    """The implementation whose training step was fastest on the measured shape nearest to ``shape``.

    Nearest in the base-2 logarithms of kernel, pull kernel, stride, image side, channels a group and groups; of two
    equally near ones the earlier in the table. ``direct`` unless another saves 10 %, and for images of more than
    twice the largest measured side, where the banded products of the others grow with the side.
    """
    rows = _table()
    if math.prod(shape.size) > 4 * max(math.prod(measured.size) for measured, _ in rows):
        return "direct"
    _, times = min(rows, key=lambda row: math.dist(row[0].place(), shape.place()))
    best = min(times, key=lambda name: times[name])
    return best if times[best] <= (1 - LEAST_GAIN) * times["direct"] else "direct"


@cache
def _table() -> list[tuple[PullShape, dict[Implementation, float]]]:
    document = json.loads(files("sextant.layers").joinpath(TABLE).read_text())
    return [(shape_of(row), row["milliseconds"]) for row in document["rows"]]


def shape_of(row: dict[str, Any]) -> PullShape:
    """The shape of a row of the table, whose kernels, strides and images are square."""
    square = {name: (row[name], row[name]) for name in ("kernel", "pull", "stride", "size")}
    counts = {name: row[name] for name in ("in_channels", "out_channels", "groups")}
    arguments: dict[str, Any] = square | counts
    return PullShape(**arguments)
