"""Plasma fractals: height maps by the diamond-square algorithm, on a torus.

Starting from one corner at height 0, every round halves the grid spacing: first the centres of the squares, then the
middles of their edges become

    height(p) = mean of the 4 neighbours of p + a · noise(p),     a ← a / decay² after each round,

with neighbours taken modulo n. The map is then shifted and scaled to fill [0, 1].

Source: Fournier, Fussell & Carpenter, "Computer rendering of stochastic models", CACM 1982. The decay is squared
because the code of ImageNet-C (Hendrycks & Dietterich, ICLR 2019) multiplies by its amplitude twice.
"""

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import Tensor

from sextant.compiled import compiled


def plasma(
    noise: Float[Tensor, "b n n"], decay: float, size: tuple[int, int] | None = None
) -> Float64[Tensor, "b h w"]:
    """Height maps in [0, 1] that grow rougher as ``decay`` falls; a map without any relief is 0.

    The CPU runs machine code, other devices whole grids, with the same result but for the last bit.

    Args:
        noise: one independent value for each point of the map, uniform in [-1, 1]; n is a power of two. The value at
            the corner (0, 0) is not used.
        decay: how much weaker finer relief is, above 0.
        size: height and width of the corner to return; None for the whole map. Heights fill [0, 1] in the whole map.

    Returns:
        Heights in double precision, so that devices agree after rounding to 8 bits.

    Raises:
        ValueError: the map is not square with a side that is a power of two.

    Example:
        >>> noise = torch.zeros(1, 2, 2)
        >>> noise[0, 1, 1] = 0.3  # lifts the centre of the one square; the middles of its edges are half as high
        >>> plasma(noise, decay=2.0)
        tensor([[[0.0000, 0.5000],
                 [0.5000, 1.0000]]], dtype=torch.float64)
    """
    n = noise.shape[-1]
    if noise.shape[-2] != n or n < 1 or n & (n - 1):
        raise ValueError(f"a plasma map is square with a side that is a power of two, not {tuple(noise.shape[-2:])}")
    if noise.device.type == "cpu":
        height = torch.zeros(noise.shape, dtype=torch.float64)
        _fill(np.ascontiguousarray(noise.numpy()), float(decay), height.numpy())
    else:
        height = _grids(noise.double(), decay)
    lowest, highest = height.amin((-2, -1), keepdim=True), height.amax((-2, -1), keepdim=True)
    relief = highest - lowest
    rows, columns = size or (n, n)
    return (height[:, :rows, :columns] - lowest) / torch.where(relief > 0, relief, 1.0)


def map_side(height: int, width: int) -> int:
    """The side of the smallest plasma map that covers an image: the next power of two.

    Example:
        >>> map_side(32, 32), map_side(224, 224), map_side(20, 33)
        (32, 256, 64)
    """
    return 1 << (max(height, width) - 1).bit_length()


def _grids(noise: Float64[Tensor, "b n n"], decay: float) -> Float64[Tensor, "b n n"]:
    height = torch.zeros_like(noise)
    step, amplitude = noise.shape[-1], 1.0
    while step >= 2:
        half = step // 2
        corners = height[:, ::step, ::step]
        below, right = corners.roll(-1, 1), corners.roll(-1, 2)
        centres = (corners + below + (right + below.roll(-1, 2))) / 4 + amplitude * noise[:, half::step, half::step]
        on_top = (centres + centres.roll(1, 1) + (corners + right)) / 4 + amplitude * noise[:, ::step, half::step]
        on_left = (centres + centres.roll(1, 2) + (corners + below)) / 4 + amplitude * noise[:, half::step, ::step]
        height[:, half::step, half::step] = centres
        height[:, ::step, half::step] = on_top
        height[:, half::step, ::step] = on_left
        step, amplitude = half, amplitude / decay**2
    return height


@compiled
def _fill(noise, decay, height):  # type: ignore[no-untyped-def]
    count, n, _ = noise.shape
    for b in range(count):
        u, z = noise[b], height[b]
        step, amplitude = n, 1.0
        while step >= 2:
            half = step // 2
            for y in range(0, n, step):
                below = (y + step) % n
                for x in range(0, n, step):
                    right = (x + step) % n
                    mean = (z[y, x] + z[below, x] + (z[y, right] + z[below, right])) / 4
                    z[y + half, x + half] = mean + amplitude * u[y + half, x + half]
            for y in range(0, n, step):
                above, below = (y - half) % n, (y + step) % n
                for x in range(0, n, step):
                    left, right = (x - half) % n, (x + step) % n
                    centre = z[y + half, x + half]
                    mean = (centre + z[above, x + half] + (z[y, x] + z[y, right])) / 4
                    z[y, x + half] = mean + amplitude * u[y, x + half]
                    mean = (centre + z[y + half, left] + (z[y, x] + z[below, x])) / 4
                    z[y + half, x] = mean + amplitude * u[y + half, x]
            step, amplitude = half, amplitude / decay**2
