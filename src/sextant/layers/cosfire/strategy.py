"""How the parts of a filter are found in the maps of one example."""

from abc import ABC, abstractmethod

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from sextant.layers.cosfire.tuples import Tuples


class Strategy(ABC):
    """Finds the parts of a filter."""

    @abstractmethod
    def tuples(self, maps: Float[Tensor, "k y x"], grid: Float[Tensor, "k p"], point: tuple[int, int]) -> Tuples:
        """The parts around ``point`` (row and column of the maps); none where there is no structure.

        Args:
            maps: the bank's description of the example, non-negative.
            grid: the channel of each map.
        """


def peaks(strength: Float[Tensor, "k y x"], window: int = 1) -> Bool[Tensor, "k y x"]:
    """Where a map is positive and the maximum of a square of side ``2 window + 1``.

    A plateau that fills its square is not a peak. With a window of 0 every positive pixel is one.
    """
    if window == 0:
        return strength > 0
    side = 2 * window + 1
    largest = F.max_pool2d(strength[None], side, 1, window)[0]
    lowest = -F.max_pool2d(-strength[None], side, 1, window)[0]
    return (strength > 0) & (strength == largest) & (largest > lowest)


def near(maps: Float[Tensor, "k y x"], point: tuple[int, int], reach: float) -> Bool[Tensor, "y x"]:
    """Which pixels of the maps lie within ``reach`` of the point (row, column)."""
    rows, columns = (torch.arange(size, device=maps.device) for size in maps.shape[1:])
    return (rows[:, None] - point[0]) ** 2 + (columns[None, :] - point[1]) ** 2 <= reach**2


def keep_apart(
    strength: Float[Tensor, "n"], y: Int64[Tensor, "n"], x: Int64[Tensor, "n"], apart: float, most: int
) -> list[int]:
    """Indices of the strongest, at most ``most``, whose places coincide or are at least ``apart`` apart."""
    kept: list[int] = []
    for index in torch.argsort(strength, descending=True, stable=True).tolist():
        squared = [int((y[index] - y[k]) ** 2 + (x[index] - x[k]) ** 2) for k in kept]
        if all(distance == 0 or distance >= apart**2 for distance in squared):
            kept.append(index)
        if len(kept) == most:
            break
    return kept
