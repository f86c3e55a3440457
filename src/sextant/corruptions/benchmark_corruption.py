"""The base of the benchmark sets' corruptions: a table with one row of parameters for each severity."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

import torch

from sextant.corruptions.contract import Positions
from sextant.corruptions.corruption import Corruption, Params, generators, image_seeds

Row = TypeVar("Row")
Mode = Literal["faithful", "corrected"]
SEVERITIES = (1, 2, 3, 4, 5)


@dataclass(frozen=True)
class BenchmarkCorruption(Corruption[Params], Generic[Row, Params]):
    """A corruption whose ``level`` is a severity 1, 2, ... that picks a row of its set's parameters.

    One class serves every set: ``SpeckleNoise((0.06, 0.1, 0.12, 0.16, 0.2), "speckle_noise")`` is that of CIFAR-10-C.
    Lengths in a table are in pixels as published, whatever the size of the image, unless a class says otherwise.

    Args:
        table: one row of parameters for each severity, the first for severity 1.
        name: the corruption's name; enters the seeds.
        levels: the severities to test at.
    """

    table: Sequence[Row]
    name: str
    levels: Sequence[float] = SEVERITIES

    def row(self, level: float) -> Row:
        """The parameters of severity ``level``.

        Raises:
            ValueError: the table has no such row.
        """
        if isinstance(level, bool) or level not in range(1, len(self.table) + 1):
            raise ValueError(f"{self.name} has severities 1 to {len(self.table)}, not {level!r}")
        return self.table[int(level) - 1]

    def check_level(self, level: float) -> None:
        """Raise a ``ValueError`` unless the table has a row for severity ``level``."""
        self.row(level)

    def streams(self, level: float, indices: Positions, seed: int) -> list[torch.Generator]:
        """One random stream for each image."""
        return generators(image_seeds(self.name, level, indices, seed))
