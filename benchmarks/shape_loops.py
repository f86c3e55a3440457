"""The corruptions that MNIST-C alone has, one digit at a time: the baseline for timings of the engine.

Written from the definitions, with the libraries of the benchmark's authors: NumPy and scikit-image.
"""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from skimage.feature import canny
from skimage.transform import AffineTransform, warp

Digit = np.ndarray  # (28, 28, 1), float64 in [0, 1]
Warp = Callable[[Digit, np.ndarray], Digit]  # by a matrix (2, 3) that maps the result into the digit; black outside
RNG = np.random.default_rng(0)


def scikit_warp(x: Digit, matrix: np.ndarray) -> Digit:
    return warp(x, AffineTransform(matrix=np.vstack([matrix, [0, 0, 1]])), order=1)


def shear(x: Digit, angle: float, warped: Warp = scikit_warp) -> Digit:
    angle *= RNG.choice((-1, 1))
    return warped(x, _about_centre(x, [[1, -math.sin(angle)], [0, math.cos(angle)]]))


def scale(x: Digit, factor: float, warped: Warp = scikit_warp) -> Digit:
    return warped(x, _about_centre(x, [[factor, 0], [0, factor]]))


def rotate(x: Digit, angle: float, warped: Warp = scikit_warp) -> Digit:
    angle *= RNG.choice((-1, 1))
    return warped(x, _about_centre(x, [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]))


def translate(x: Digit, pixels: float, warped: Warp = scikit_warp) -> Digit:
    return warped(x, np.column_stack([np.eye(2), pixels * RNG.choice((-1, 1), 2)]))


def stripe(x: Digit) -> Digit:
    y = x.copy()
    y[:, :7], y[:, 21:] = 1 - x[:, :7], 1 - x[:, 21:]
    return y


def dotted_line(x: Digit) -> Digit:
    start, end = RNG.integers(0, 27, 2)
    line = _line((0, start), (27, end))
    line[:, np.arange(28) // 2 % 2 == 0] = 0
    return np.clip(x + line[..., None], 0, 1)


def zigzag(x: Digit) -> Digit:
    start, rise = RNG.integers(0, 27), RNG.integers(-5, 5)
    angle = math.atan2(rise, 23)
    length = 23 / math.cos(angle)
    wave, at, side = [(0.0, 0.0)], 2, 2.0
    while at <= length:
        wave.append((at, side))
        at, side = at + 4, -side
    wave.append((length, -side / (2 * (length % 4))))
    cosine, sine = math.cos(angle), math.sin(angle)
    corners = [(2 + cosine * along - sine * off, start + sine * along + cosine * off) for along, off in wave]
    lines = sum(_line(*ends) for ends in pairwise(corners))
    return np.clip(x + lines[..., None], 0, 1)


def canny_edges(x: Digit) -> Digit:
    return canny(x[..., 0])[..., None].astype(np.float64)


def _about_centre(x: Digit, linear: list[list[float]]) -> np.ndarray:
    centre = (np.array(x.shape[1::-1]) - 1) / 2
    return np.column_stack([linear, centre - linear @ centre])


def _line(start: tuple[float, float], end: tuple[float, float]) -> np.ndarray:
    """A soft line from ``start`` to ``end``, (column, row): ``1 + log(1 - d/2.3)``, d the vertical distance."""
    line = np.zeros((28, 28))
    if start[0] == end[0]:
        return line
    columns = np.arange(max(math.floor(start[0]), 0), min(math.ceil(end[0]), 28))
    heights = start[1] + (end[1] - start[1]) / (end[0] - start[0]) * (columns - start[0])
    distance = np.minimum(np.abs(np.arange(28)[:, None] - heights), 2.2999)
    line[:, columns] = np.maximum(1 + np.log1p(-distance / 2.3), 0)
    return line


#: by the name of the corruption; called with a digit and a row of the set's table
LOOPS: dict[str, Callable[..., Digit]] = {
    f.__name__: f for f in (shear, scale, rotate, translate, stripe, dotted_line, zigzag, canny_edges)
}
