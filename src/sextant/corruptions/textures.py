"""Textures for weather: plasma fractals and frost."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
import torch
from jaxtyping import Float, Float64
from numpy.typing import NDArray
from torch import Tensor

from sextant.compiled import compiled


def plasma(
    noise: Float[Tensor, "b n n"], decay: float, size: tuple[int, int] | None = None
) -> Float64[Tensor, "b h w"]:
    """Height maps in [0, 1] that grow rougher as ``decay`` falls; a map without any relief is 0.

    Starting from one corner at height 0, every round halves the grid spacing: first the centres of the squares, then
    the middles of their edges become

        height(p) = mean of the 4 neighbours of p + a · noise(p),     a ← a / decay² after each round,

    with neighbours taken modulo n. The map is then shifted and scaled to fill [0, 1].

    Source: Fournier, Fussell & Carpenter, "Computer rendering of stochastic models", CACM 1982. The decay is squared
    because the code of ImageNet-C (Hendrycks & Dietterich, ICLR 2019) multiplies by its amplitude twice.

    The CPU runs machine code, other devices whole grids, with the same result but for the last bit.

    Args:
        noise: one independent value for each point of the map, uniform in [-1, 1]; n is a power of two. The value at
            the corner (0, 0) is not used.
        decay: decrease of the relief from coarse to fine, above 0.
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


HEIGHT, WIDTH = 768, 1024
SHADOW, ICE = np.array([0.10, 0.19, 0.31]), np.array([0.93, 0.97, 1.0])  # red, green, blue
FRACTION_BITS = 4  # of the coordinates that OpenCV draws at
HAZE_DECAY = 1.45
SHORTEST = 4.0  # pixels of a branch

Curves = NDArray[np.float64]  # (curves, points, 2), x and y in pixels


@dataclass(frozen=True)
class FrostKind:
    """The growth of one texture.

    Frost on a window grows as dendrites: a stem with branches at about 60 degrees, which branch again. Five textures
    differ in how many stems there are, where they start, how they bend and how far they branch. They stand in for the
    photographs that the authors of the corruption benchmarks used, so errors under frost are not comparable with
    published ones.

    The textures never change: NumPy's ``RandomState``, whose streams are frozen, draws them from fixed seeds.

    Attributes:
        stems: number of stems.
        length: length of a stem as a share of the height, least and most.
        bend: spread of the turn of a stem in radians over its length.
        angle: angle between a branch and its stem, in radians.
        spacing: pixels between two branches.
        branch: length of the longest branch as a share of its stem.
        arms: number of stems that leave one seed.
        from_edges: whether seeds lie on the border and grow inward, or lie anywhere.
        haze: share of the haze in the brightness.
    """

    stems: int
    length: tuple[float, float]
    bend: float
    angle: float
    spacing: float
    branch: float
    arms: int
    from_edges: bool
    haze: float


KINDS = (
    FrostKind(34, (0.35, 0.9), 1.2, 0.9, 9, 0.34, 1, True, 0.35),  # ferns from the frame
    FrostKind(150, (0.08, 0.26), 0.2, 1.05, 8, 0.45, 6, False, 0.30),  # stars
    FrostKind(220, (0.10, 0.4), 0.5, 0.6, 10, 0.20, 2, False, 0.35),  # needles
    FrostKind(60, (0.25, 0.6), 2.2, 0.8, 9, 0.30, 2, False, 0.30),  # feathers that curl
    FrostKind(36, (0.50, 1.1), 0.7, 1.05, 10, 0.28, 1, True, 0.50),  # hoar
)


@cache
def frost_texture(kind: int) -> NDArray[np.float32]:
    """The texture of number ``kind`` in 0 ... 4: (768, 1024, 3), red, green, blue in [0, 1]; read-only."""
    random = np.random.RandomState(1000 + kind)
    ice = _crystals(KINDS[kind], random)
    haze = _haze(random)
    share = KINDS[kind].haze
    brightness = np.clip((1 - share) * ice + share * haze + 0.25 * ice * haze, 0, 1)[..., None]
    texture: NDArray[np.float32] = (SHADOW + (ICE - SHADOW) * brightness).astype(np.float32)
    texture.setflags(write=False)
    return texture


def _crystals(kind: FrostKind, random: np.random.RandomState) -> NDArray[np.float64]:
    """Plants of ice, each with two orders of branches; a later one lies over an earlier one and shades it."""
    canvas = np.zeros((HEIGHT, WIDTH), np.uint8)
    for stem in _stems(kind, random):
        branches = _branches(stem, kind, random)
        twigs = _branches(branches, kind, random)
        bright = random.uniform(0.45, 1)
        for curves, thickness, shade in ((stem, 7, 0.45), (branches, 5, 0.45), (twigs, 1, 0.6)):
            _draw(canvas, curves, thickness, shade * bright)
        _draw(canvas, branches, 1, 0.85 * bright)
        _draw(canvas, stem, 2, bright)
    lines = canvas.astype(np.float64) / 255
    return 1.2 * lines + 0.5 * cv2.GaussianBlur(lines, (0, 0), 8.0)


def _stems(kind: FrostKind, random: np.random.RandomState) -> list[Curves]:
    """Stems (1, p, 2), in the order in which they grow."""
    stems = []
    for _ in range(kind.stems // kind.arms):
        start, heading = _seed(kind, random)
        length = random.uniform(*kind.length) * HEIGHT
        for arm in range(kind.arms):
            turn = random.normal(0, kind.bend)
            stems.append(_curve(start, heading + 2 * np.pi * arm / kind.arms, length, turn))
    return stems


def _seed(kind: FrostKind, random: np.random.RandomState) -> tuple[NDArray[np.float64], float]:
    x, y, angle = random.uniform(0, WIDTH), random.uniform(0, HEIGHT), random.uniform(0, 2 * np.pi)
    if not kind.from_edges:
        return np.array([x, y]), angle
    side, lean = random.randint(4), random.normal(0, 0.6)
    start = ([x, 0], [WIDTH, y], [x, HEIGHT], [0, y])[side]
    return np.array(start, float), float(np.pi / 2 * (side + 1) + lean)


def _curve(start: NDArray[np.float64], heading: float, length: float, turn: float) -> Curves:
    """One arc (1, p, 2) in equal steps of some 4 pixels."""
    count = max(2, int(length / 4))
    angles = heading + turn * np.linspace(0, 1, count) ** 1.5
    steps = np.stack([np.cos(angles), np.sin(angles)], -1) * (length / count)
    return np.concatenate([start[None], start + np.cumsum(steps, 0)])[None]


def _branches(curves: Curves, kind: FrostKind, random: np.random.RandomState) -> Curves:
    """Straight branches (m, 2, 2) on both sides of all curves, longest in a curve's first half, shorter to its tip."""
    steps = np.diff(curves, axis=1)
    total = np.hypot(steps[..., 0], steps[..., 1]).sum(1)
    counts = 2 * (total / kind.spacing).astype(int)
    owner = np.repeat(np.arange(len(curves)), counts)
    nth = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (nth // 2 + random.uniform(size=len(owner))) * kind.spacing / total[owner]
    reach = kind.branch * total[owner] * np.minimum(1, 4 * share) * (1 - share) * random.uniform(0.5, 1, len(owner))
    vertex = np.clip(np.ceil(share * steps.shape[1]).astype(int), 1, steps.shape[1])
    direction = steps[owner, vertex - 1]
    turn = (nth % 2 * 2 - 1) * (kind.angle + random.normal(0, 0.08, len(owner)))
    heading = np.arctan2(direction[:, 1], direction[:, 0]) + turn
    roots = curves[owner, vertex]
    tips = roots + reach[:, None] * np.stack([np.cos(heading), np.sin(heading)], -1)
    branches: Curves = np.stack([roots, tips], 1)[reach >= SHORTEST]
    return branches


def _draw(canvas: NDArray[np.uint8], curves: Curves, thickness: int, brightness: float) -> None:
    points = np.round(curves * 2**FRACTION_BITS).astype(np.int32)
    cv2.polylines(canvas, list(points), False, 255 * brightness, thickness, cv2.LINE_AA, FRACTION_BITS)


def _haze(random: np.random.RandomState) -> NDArray[np.float64]:
    """A plasma fractal: breath on the glass."""
    noise = torch.from_numpy(random.uniform(-1, 1, (1, 1024, 1024)))
    return np.asarray(plasma(noise, HAZE_DECAY, (HEIGHT, WIDTH))[0].numpy())
