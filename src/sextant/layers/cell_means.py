"""Means over the cells of a grid, with a backward pass that is deterministic on GPUs too."""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor


def cell_means(x: Float[Tensor, "b c h w"], grid: tuple[int, int]) -> Float[Tensor, "b c p q"]:
    """Average a feature map over each of p x q cells, like ``torch.nn.functional.adaptive_avg_pool2d``.

    Cell i of p covers rows ⌊i h / p⌋ up to but not including ⌈(i + 1) h / p⌉, and columns likewise. On a GPU, PyTorch's
    backward pass adds in no fixed order and raises under ``torch.use_deterministic_algorithms``; in that mode two
    matrix products, equal up to rounding, take its place.

    Args:
        x: the feature map.
        grid: rows and columns of cells, p and q.

    >>> cell_means(torch.arange(8.0).reshape(1, 1, 2, 4), (1, 2))
    tensor([[[[2.5000, 4.5000]]]])
    """
    if x.is_cuda and torch.are_deterministic_algorithms_enabled():
        return _by_products(x, grid)
    return F.adaptive_avg_pool2d(x, grid)


def _by_products(x: Float[Tensor, "b c h w"], grid: tuple[int, int]) -> Float[Tensor, "b c p q"]:
    rows, columns = (_shares(side, cells, x.device).to(x.dtype) for side, cells in zip(x.shape[-2:], grid, strict=True))
    return rows @ x @ columns.T


def _shares(side: int, cells: int, device: torch.device) -> Float[Tensor, "p h"]:
    """Weight of each line of a map in each cell."""
    cell, line = torch.arange(cells, device=device)[:, None], torch.arange(side, device=device)
    inside = (line >= cell * side // cells) & (line < -(-(cell + 1) * side // cells))
    return inside / inside.sum(1, keepdim=True)
