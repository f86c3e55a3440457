"""Bilinear sampling of a batch at points given in pixels, with scipy.ndimage's borders.

The CPU runs a compiled loop over points, other devices use gathers; the two add in the same order and agree up to
rounding.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from sextant.compiled import compiled
from sextant.corruptions.filtering.border import Border, inside

_NEAREST, _REFLECT, _MIRROR, _ZERO = 0, 1, 2, 3
_KINDS: dict[Border, int] = {"nearest": _NEAREST, "reflect": _REFLECT, "mirror": _MIRROR, "zero": _ZERO}


def bilinear(
    images: Float[Tensor, "b c h w"],
    rows: Float[Tensor, "b p q"],
    columns: Float[Tensor, "b p q"],
    border: Border,
) -> Float[Tensor, "b c p q"]:
    """``images`` at (row, column), the centre of the first pixel at (0, 0), interpolated linearly along each axis.

    Equal to ``scipy.ndimage.map_coordinates`` of order 1, and for ``zero`` to a warp whose surroundings are black.

    Raises:
        ValueError: there are not as many points as images, or not as many rows as columns.

    Example:
        >>> image = torch.tensor([[[[0.0, 1.0, 2.0]]]])
        >>> rows, columns = torch.zeros(1, 1, 3), torch.tensor([[[0.5, 2.0, 2.5]]])
        >>> bilinear(image, rows, columns, "nearest").flatten(), bilinear(image, rows, columns, "zero").flatten()
        (tensor([0.5000, 2.0000, 2.0000]), tensor([0.5000, 2.0000, 1.0000]))
    """
    if rows.shape != columns.shape or len(rows) != len(images):  # the compiled loop does not look
        raise ValueError(
            f"{len(images)} images, rows {tuple(rows.shape)} and columns {tuple(columns.shape)} do not match"
        )
    if images.device.type != "cpu" or images.dtype not in (torch.float32, torch.float64):
        return _gathered(images, rows, columns, border)
    result = images.new_empty(*images.shape[:2], *rows.shape[1:])
    source, places = images.detach().contiguous(), (rows.to(images).contiguous(), columns.to(images).contiguous())
    _sampled(source.numpy(), places[0].numpy(), places[1].numpy(), _KINDS[border], result.numpy())
    return result


def _gathered(
    images: Float[Tensor, "b c h w"], rows: Float[Tensor, "b p q"], columns: Float[Tensor, "b p q"], border: Border
) -> Float[Tensor, "b c p q"]:
    height, width = images.shape[-2:]
    top, left = rows.floor(), columns.floor()
    down, right = rows - top, columns - left
    top, left = top.long(), left.long()
    flat = images.flatten(2)
    result = images.new_zeros(*images.shape[:2], *rows.shape[1:])
    for i, weight_i in ((top, 1 - down), (top + 1, down)):
        for j, weight_j in ((left, 1 - right), (left + 1, right)):
            weight = weight_i * weight_j
            if border == "zero":
                weight = weight * ((i >= 0) & (i < height) & (j >= 0) & (j < width))
            place = inside(i, height, border) * width + inside(j, width, border)
            corner = flat.gather(2, place.flatten(1)[:, None].expand(-1, images.shape[1], -1))
            result += corner.view_as(result) * weight[:, None]
    return result


@compiled
def _inside(index, size, kind):  # type: ignore[no-untyped-def]
    """As :func:`.border.inside`."""
    if 0 <= index < size:
        return index
    if kind == _REFLECT:
        folded = index % (2 * size)
        return folded if folded < size else 2 * size - 1 - folded
    if kind == _MIRROR and size > 1:
        folded = index % (2 * size - 2)
        return folded if folded < size else 2 * size - 2 - folded
    return 0 if index < 0 else size - 1


@compiled
def _sampled(images, rows, columns, kind, result):  # type: ignore[no-untyped-def]
    count, channels, height, width = images.shape
    one = images.dtype.type(1)
    for b in range(count):
        for p in range(rows.shape[1]):
            for q in range(rows.shape[2]):
                row, column = rows[b, p, q], columns[b, p, q]
                top, left = math.floor(row), math.floor(column)
                down, right = row - images.dtype.type(top), column - images.dtype.type(left)
                up, back = one - down, one - right
                i, j, k, m = int(top), int(left), int(top) + 1, int(left) + 1
                if kind == _ZERO:
                    up, down = up * (0 <= i < height), down * (0 <= k < height)
                    back, right = back * (0 <= j < width), right * (0 <= m < width)
                i, k = _inside(i, height, kind), _inside(k, height, kind)
                j, m = _inside(j, width, kind), _inside(m, width, kind)
                a, b_, c_, d = up * back, up * right, down * back, down * right
                for c in range(channels):
                    image = images[b, c]
                    result[b, c, p, q] = a * image[i, j] + b_ * image[i, m] + c_ * image[k, j] + d * image[k, m]
