r"""Weighted sums of shifted images, :math:`y_b(p) = \sum_i k_i\, x_b(p + d_{bi})`, each image with its own shifts.

The CPU runs a compiled loop over rows, other devices use gathers; the two add in the same order and agree up to
rounding.
"""

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.compiled import compiled
from sextant.corruptions.filtering.border import Border, inside


def shifted_sum(
    images: Float[Tensor, "b c h w"], weights: Float[Tensor, "n"], shifts: Int64[Tensor, "b n 2"], border: Border
) -> Float[Tensor, "b c h w"]:
    """The sums, with the type of ``images``.

    Args:
        images: images on any device.
        weights: weights of the terms.
        shifts: (column, row) in whole pixels, for each image or, with b = 1, for all.
        border: ``nearest``, ``reflect`` or ``mirror``.

    Raises:
        ValueError: there are shifts for another number of images or terms.

    Example:
        >>> row = torch.tensor([1.0, 2.0, 4.0]).view(1, 1, 1, 3)
        >>> shifts = torch.tensor([[[0, 0], [1, 0]]])  # each pixel and its neighbour to the right
        >>> shifted_sum(row, torch.tensor([0.5, 0.5]), shifts, "nearest").flatten()
        tensor([1.5000, 3.0000, 4.0000])
    """
    if len(shifts) not in (1, len(images)) or shifts.shape[1:] != (len(weights), 2):  # the compiled loop does not look
        raise ValueError(f"{len(images)} images, {len(weights)} weights and shifts {tuple(shifts.shape)} do not match")
    height, width = images.shape[-2:]
    if images.device.type == "cpu" and images.dtype in (torch.float32, torch.float64):
        margin = shifts.abs().amax((0, 1)) if shifts.numel() else torch.zeros(2, dtype=torch.int64)
        across, down = margin.tolist()
        columns = inside(torch.arange(-across, width + across), width, border)
        rows = inside(torch.arange(-down, height + down), height, border)
        result = torch.empty_like(images, memory_format=torch.contiguous_format)
        _sum_on_cpu(
            images.detach().contiguous().numpy(),
            weights.to(images).numpy(),
            (shifts + margin).numpy(),
            rows.numpy(),
            columns.numpy(),
            result.numpy(),
        )
        return result
    return _sum_of_gathers(images, weights, shifts, border)


def _sum_of_gathers(
    images: Float[Tensor, "b c h w"], weights: Float[Tensor, "n"], shifts: Int64[Tensor, "b n 2"], border: Border
) -> Float[Tensor, "b c h w"]:
    (count, channels, height, width), device = images.shape, images.device
    rows, columns = (torch.arange(n, device=device) for n in (height, width))
    flat, result = images.flatten(2), torch.zeros_like(images)
    shifts = shifts.to(device).expand(count, -1, -1)
    for i, weight in enumerate(weights.tolist()):
        row = inside(rows + shifts[:, i, 1:], height, border)
        column = inside(columns + shifts[:, i, :1], width, border)
        place = (row[:, :, None] * width + column[:, None]).flatten(1)
        result += weight * flat.gather(2, place[:, None].expand(-1, channels, -1)).view_as(images)
    return result


@compiled
def _sum_on_cpu(source, weights, shifts, rows, columns, result):  # type: ignore[no-untyped-def]
    """``rows`` and ``columns`` name the pixels of the image with its margin; ``shifts`` are from its corner."""
    count, channels, height, width = source.shape
    padded = np.empty((len(rows), len(columns)), source.dtype)
    shared = len(shifts) == 1
    for b in range(count):
        moves = shifts[0] if shared else shifts[b]
        for c in range(channels):
            for y in range(len(rows)):
                for x in range(len(columns)):
                    padded[y, x] = source[b, c, rows[y], columns[x]]
            for y in range(height):
                target = result[b, c, y]
                target[:] = 0
                for i in range(len(weights)):
                    weight = weights[i]
                    line = padded[y + moves[i, 1], moves[i, 0] : moves[i, 0] + width]
                    for x in range(width):
                        target[x] += weight * line[x]
