"""Filtering and sampling of batches, as SciPy, scikit-image and ImageMagick do it one image at a time."""

import math
from functools import lru_cache
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.compiled import compiled
from sextant.corruptions.contract import Images
from sextant.tables import counted

Border = Literal["nearest", "reflect", "mirror", "zero"]


def inside(index: Int64[Tensor, "*n"], size: int, border: Border) -> Int64[Tensor, "*n"]:
    """The pixel 0 ... size - 1 that stands for the pixel ``index``, which may lie outside.

    ``nearest`` repeats the edge pixel; ``reflect`` mirrors at the edge of the edge pixel (b a | a b c), ``mirror`` at
    its centre (c b | a b c), which OpenCV calls REFLECT_101; ``zero`` is black.

    ``zero`` gives the nearest pixel, to which the caller has to give weight zero.

    Example:
        >>> index = torch.arange(-2, 6)  # from two pixels before an axis of four to two behind it
        >>> inside(index, 4, "nearest").tolist()
        [0, 0, 0, 1, 2, 3, 3, 3]
        >>> inside(index, 4, "reflect").tolist()
        [1, 0, 0, 1, 2, 3, 3, 2]
        >>> inside(index, 4, "mirror").tolist()
        [2, 1, 0, 1, 2, 3, 2, 1]
    """
    if border == "reflect":
        folded = index % (2 * size)
        return torch.where(folded < size, folded, 2 * size - 1 - folded)
    if border == "mirror" and size > 1:
        folded = index % (2 * size - 2)
        return torch.where(folded < size, folded, 2 * size - 2 - folded)
    return index.clamp(0, size - 1)


_NEAREST, _REFLECT, _MIRROR, _ZERO = 0, 1, 2, 3
_KINDS: dict[Border, int] = {"nearest": _NEAREST, "reflect": _REFLECT, "mirror": _MIRROR, "zero": _ZERO}


def bilinear(
    images: Images, rows: Float[Tensor, "b p q"], columns: Float[Tensor, "b p q"], border: Border
) -> Float[Tensor, "b c p q"]:
    """``images`` at (row, column), the centre of the first pixel at (0, 0), interpolated linearly along each axis.

    The CPU runs a compiled loop over points, other devices use gathers; the two add in the same order and agree up to
    rounding.

    Equal to ``scipy.ndimage.map_coordinates`` of order 1, and for ``zero`` to a warp whose surroundings are black.

    Raises:
        ValueError: there are not as many points as images, or not as many rows as columns.

    Example:
        >>> image = torch.tensor([[[[0.0, 1.0, 2.0]]]])
        >>> rows, columns = torch.zeros(1, 1, 3), torch.tensor([[[0.5, 2.0, 2.5]]])
        >>> bilinear(image, rows, columns, "nearest").flatten(), bilinear(image, rows, columns, "zero").flatten()
        (tensor([0.5000, 2.0000, 2.0000]), tensor([0.5000, 2.0000, 1.0000]))
    """
    if rows.shape != columns.shape or len(rows) != len(images):  # the compiled loop does not check
        raise ValueError(
            f"{counted(len(images), 'image')}, rows {tuple(rows.shape)} and columns {tuple(columns.shape)} do not match"
        )
    if images.device.type != "cpu" or images.dtype not in (torch.float32, torch.float64):
        return _gathered(images, rows, columns, border)
    result = images.new_empty(*images.shape[:2], *rows.shape[1:])
    source, places = images.detach().contiguous(), (rows.to(images).contiguous(), columns.to(images).contiguous())
    _sampled(source.numpy(), places[0].numpy(), places[1].numpy(), _KINDS[border], result.numpy())
    return result


def _gathered(
    images: Images, rows: Float[Tensor, "b p q"], columns: Float[Tensor, "b p q"], border: Border
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
    """As :func:`inside`."""
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


@lru_cache(maxsize=512)
def zoom_matrix(size: int, factor: float) -> Tensor:
    """The zoom by ``factor`` ≥ 1 along an axis of ``size`` pixels ``(size, size)``; float64, not to be changed."""
    kept = math.ceil(size / factor)
    magnified = round(kept * factor)
    first = (size - kept) // 2
    rows = torch.arange(size)
    step = (kept - 1) / (magnified - 1) if magnified > 1 else 0.0
    source = (rows + (magnified - size) // 2).double() * step
    left = source.floor().long().clamp(0, max(kept - 2, 0))
    weight = source - left
    matrix = torch.zeros(size, size, dtype=torch.float64)
    matrix[rows, first + left] += 1 - weight
    matrix[rows, first + (left + 1).clamp(max=kept - 1)] += weight
    return matrix


def clipped_zoom(images: Images, factor: float) -> Images:
    r"""The centre of ``images`` magnified by ``factor`` ≥ 1, of the same size.

    The central :math:`c = \lceil n/z \rceil` pixels of an axis of n are magnified to :math:`m = \mathrm{round}(c z)` by
    linear interpolation that maps the first pixel onto the first and the last onto the last
    (:func:`scipy.ndimage.zoom` of order 1), and the central n of these are kept. An axis is one matrix ``(n, n)``.

    Source: Hendrycks & Dietterich, ICLR 2019; ``clipped_zoom`` in hendrycks/robustness. There the image is square.

    Example:
        >>> image = torch.tensor([9.0, 1.0, 4.0, 9.0]).expand(1, 1, 4, 4)
        >>> clipped_zoom(image, 2.0)[0, 0, 0].round(decimals=4)  # the middle two pixels, stretched over four
        tensor([1., 2., 3., 4.])
    """
    height, width = images.shape[-2:]
    return zoom_matrix(height, factor).to(images) @ images @ zoom_matrix(width, factor).to(images).T


def gaussian_weights(sigma: float, radius: int) -> Float[Tensor, "n"]:
    """``exp(-k²/2σ²)`` for k = -radius ... radius, scaled to the sum 1; float64.

    Example:
        >>> gaussian_weights(1.0, 1).round(decimals=4)  # in proportion to exp(-1/2), 1 and exp(-1/2)
        tensor([0.2741, 0.4519, 0.2741], dtype=torch.float64)
        >>> gaussian_weights(0.0, 1)  # changes nothing
        tensor([1.], dtype=torch.float64)
    """
    if sigma <= 0 or radius == 0:
        return torch.ones(1, dtype=torch.float64)
    weights = torch.exp(-0.5 * (torch.arange(-radius, radius + 1, dtype=torch.float64) / sigma) ** 2)
    return weights / weights.sum()


@lru_cache(maxsize=128)
def gaussian_matrix(size: int, sigma: float, border: Border = "nearest", truncate: float = 4.0) -> Tensor:
    """Smoothing along an axis of ``size`` pixels as a matrix ``(size, size)``; float64, not to be changed."""
    weights = gaussian_weights(sigma, int(truncate * sigma + 0.5))
    reach = len(weights) // 2
    rows = torch.arange(size)[:, None].expand(size, len(weights))
    columns = inside(rows + torch.arange(-reach, reach + 1), size, border)
    return torch.zeros(size, size, dtype=torch.float64).index_put_((rows, columns), weights.expand_as(rows), True)


def gaussian_filter(
    images: Images, sigma: float | tuple[float, float], border: Border = "nearest", truncate: float = 4.0
) -> Images:
    r"""``images`` smoothed by ``sigma`` pixels, or by (down, across); an axis with ``sigma = 0`` is unchanged.

    Each axis is one matrix, :math:`Y = G_h X G_w^T`, with :math:`G_{ij} = \sum_{k:\, b(i+k)=j} g_k`, where b folds
    positions beyond the edge back into the image and :math:`g_k \propto e^{-k^2 / 2σ^2}` for
    :math:`|k| \le \lfloor tσ + 1/2 \rfloor`.
    For small images this is faster than convolution, and any border is exact.

    Example:
        >>> spot = torch.zeros(1, 1, 5, 5)
        >>> spot[..., 2, 2] = 1
        >>> gaussian_filter(spot, (0.5, 0.0))[0, 0].round(decimals=2)  # down alone
        tensor([[0.0000, 0.0000, 0.0000, 0.0000, 0.0000],
                [0.0000, 0.0000, 0.1100, 0.0000, 0.0000],
                [0.0000, 0.0000, 0.7900, 0.0000, 0.0000],
                [0.0000, 0.0000, 0.1100, 0.0000, 0.0000],
                [0.0000, 0.0000, 0.0000, 0.0000, 0.0000]])
    """
    down, across = sigma if isinstance(sigma, tuple) else (sigma, sigma)
    if down > 0:
        images = gaussian_matrix(images.shape[-2], down, border, truncate).to(images) @ images
    if across > 0:
        images = images @ gaussian_matrix(images.shape[-1], across, border, truncate).to(images).T
    return images


def motion_weights(radius: float, sigma: float) -> Float[Tensor, "w"]:
    """The weights along the line, from the pixel itself outward; sum 1; float64.

    Example:
        >>> motion_weights(1.0, 1.0).round(decimals=4)  # in proportion to 1, exp(-1/2) and exp(-2)
        tensor([0.5741, 0.3482, 0.0777], dtype=torch.float64)
    """
    steps = torch.arange(2 * math.ceil(radius) + 1, dtype=torch.float64)
    weights = torch.exp(-(steps**2) / (2 * sigma**2))
    return weights / weights.sum()


def motion_offsets(degrees: Float[Tensor, "b"], count: int) -> Int64[Tensor, "b n 2"]:
    """(column, row) of the ``count`` pixels along each line.

    Example:
        >>> motion_offsets(torch.tensor([0.0, 90.0]), 3).tolist()  # to the right, and down
        [[[0, 0], [1, 0], [2, 0]], [[0, 0], [0, 1], [0, 2]]]
    """
    angle = torch.deg2rad(degrees.double().cpu())
    line = torch.stack([angle.cos(), angle.sin()], -1)
    steps = torch.arange(count, dtype=torch.float64)
    return torch.ceil(steps[None, :, None] * line[:, None] - 0.5).long()


def motion_blur(images: Images, radius: float, sigma: float, degrees: Float[Tensor, "b"]) -> Images:
    r"""Blur each of ``images`` along its own angle (degrees, clockwise from the right as rows point down).

    .. math:: y(p) = \sum_{i=0}^{W-1} k_i\, x\bigl(p + \lceil i (\cos θ, \sin θ) - \tfrac12 \rceil\bigr),
        \qquad k_i \propto e^{-i^2 / 2σ^2}, \qquad W = 2\lceil r \rceil + 1

    in (column, row) with rows downward: a one-sided Gaussian, sampled at the nearest pixel, with the edge pixels
    repeated beyond the edge. r and σ are in pixels. Source: ``MotionBlurImage`` of ImageMagick 6 and 7, which the
    authors of the benchmarks call; ImageMagick itself is not needed.

    Example:
        >>> spot = torch.tensor([0.0, 0.0, 0.0, 1.0, 0.0]).view(1, 1, 1, 5)
        >>> blurred = motion_blur(spot, radius=1.0, sigma=1.0, degrees=torch.tensor([0.0]))
        >>> blurred.flatten().round(decimals=2)  # a pixel takes from those to its right
        tensor([0.0000, 0.0800, 0.3500, 0.5700, 0.0000])
    """
    weights = motion_weights(radius, sigma)
    return shifted_sum(images, weights, motion_offsets(degrees, len(weights)), "nearest")


def shifted_sum(images: Images, weights: Float[Tensor, "n"], shifts: Int64[Tensor, "b n 2"], border: Border) -> Images:
    """The sums, with the type of ``images``.

    The CPU runs a compiled loop over rows, other devices use gathers; the two add in the same order and agree up to
    rounding.

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
    if len(shifts) not in (1, len(images)) or shifts.shape[1:] != (len(weights), 2):  # the compiled loop does not check
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
    images: Images, weights: Float[Tensor, "n"], shifts: Int64[Tensor, "b n 2"], border: Border
) -> Images:
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
