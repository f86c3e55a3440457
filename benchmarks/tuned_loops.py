"""Corruptions one picture at a time, as fast as we can make them with OpenCV and NumPy: the engine's stronger baseline.

Only those that we can make faster than the authors' libraries do, in :mod:`benchmarks.corruption_loops` and
:mod:`benchmarks.shape_loops`. OpenCV rounds the points of a warp to 1/32 of a pixel, where the engine is exact.
"""

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
from scipy import ndimage

from benchmarks.corruption_loops import RNG, Picture
from benchmarks.shape_loops import rotate, scale, shear, translate

EDGE = cv2.BORDER_REPLICATE


def gaussian_blur(x: Picture, sigma: float) -> Picture:
    return np.clip(_smooth(x, sigma), 0, 1)


def glass_blur(x: Picture, sigma: float, reach: int, passes: int, chance: float, down_only: bool) -> Picture:
    """Swaps entries of a list of pixel indices, with all moves drawn at once."""
    height, width, channels = x.shape
    places = list(range(height * width))
    for _ in range(passes):
        moves = RNG.integers(-reach, reach, (height, width, 2))
        shifts = moves[..., 0] + width * moves[..., 1]
        if chance < 1:
            shifts[RNG.random((height, width)) >= chance] = 0
        steps = shifts.ravel().tolist()
        for row in range(height - reach, reach, -1):
            for here in range(row * width + width - reach, row * width + reach, -1):
                there = here + steps[here - width - 1]
                if channels == 1:
                    places[here], places[there] = places[there], places[here]
                else:
                    places[here] = places[there]
    y = np.uint8(_smooth(x, sigma, down_only) * 255).reshape(height * width, -1)[places].reshape(x.shape)
    return np.clip(_smooth(y / 255, sigma, down_only), 0, 1)


def motion_blur(x: Picture, radius: float, sigma: float) -> Picture:
    return np.round(_blown(x, radius, sigma, RNG.uniform(-45, 45)) * 255) / 255


def zoom_blur(x: Picture, end: float, step: float) -> Picture:
    factors = np.arange(1, end, step)
    return np.clip((x + sum(_magnified(x, factor) for factor in factors)) / (len(factors) + 1), 0, 1)


def snow(
    x: Picture, mean: float, spread: float, zoom: float, threshold: float, radius: float, sigma: float, mix: float
) -> Picture:
    x = x.astype(np.float32)
    flakes = _magnified(RNG.normal(mean, spread, (*x.shape[:2], 1)).astype(np.float32), zoom)
    flakes[flakes < threshold] = 0
    flakes = np.uint8(np.clip(flakes, 0, 1) * 255) / np.float32(255)
    flakes = np.round(_blown(flakes, radius, sigma, RNG.uniform(-135, -45)) * 255) / 255
    grey = cv2.cvtColor(x, cv2.COLOR_RGB2GRAY)[..., None]
    whiter = mix * x + (1 - mix) * np.maximum(x, 1.5 * grey + 0.5)
    return np.clip(whiter + flakes + flakes[::-1, ::-1], 0, 1)


def brightness(x: Picture, shift: float) -> Picture:
    if x.shape[-1] == 1:
        return np.clip(x + shift, 0, 1)
    hsv = cv2.cvtColor(x.astype(np.float32), cv2.COLOR_RGB2HSV)
    hsv[..., 2] = np.clip(hsv[..., 2] + shift, 0, 1)
    return cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)


def saturate(x: Picture, factor: float, shift: float) -> Picture:
    hsv = cv2.cvtColor(x.astype(np.float32), cv2.COLOR_RGB2HSV)
    hsv[..., 1] = np.clip(hsv[..., 1] * factor + shift, 0, 1)
    return cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)


def elastic_transform(x: Picture, alpha: float, sigma: float, gamma: float, unit: float) -> Picture:
    x = x.astype(np.float32)
    height, width = x.shape[:2]
    side, half = min(height, width) * unit, min(height, width) // 3
    corners = np.float32([height // 2, width // 2] + half * np.array([[1, 1], [1, -1], [-1, -1]]))
    moved = corners + RNG.uniform(-gamma * side, gamma * side, (3, 2)).astype(np.float32)
    x = cv2.warpAffine(x, cv2.getAffineTransform(corners, moved), (width, height), borderMode=cv2.BORDER_REFLECT_101)
    if alpha:
        noise = RNG.uniform(-1, 1, (height, width, 2)).astype(np.float32)
        shifts = np.float32(alpha * side) * _smooth_noise(noise, sigma * side)
        rows, columns = np.mgrid[:height, :width].astype(np.float32)
        x = cv2.remap(x, columns + shifts[..., 0], rows + shifts[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_REFLECT)
    return np.clip(x, 0, 1)


def _smooth(x: Picture, sigma: float, down_only: bool = False) -> Picture:
    size = 2 * int(4 * sigma + 0.5) + 1
    down = cv2.getGaussianKernel(size, sigma)
    return cv2.sepFilter2D(x, -1, np.ones(1) if down_only else down, down, borderType=EDGE).reshape(x.shape)


def _smooth_noise(noise: np.ndarray, sigma: float) -> np.ndarray:
    reach, (height, width, _) = int(3 * sigma + 0.5), noise.shape
    if reach >= min(height, width):  # OpenCV is slow with kernels larger than the picture
        return ndimage.gaussian_filter(noise, (sigma, sigma, 0), truncate=3)
    weights = cv2.getGaussianKernel(2 * reach + 1, sigma)
    padded = cv2.copyMakeBorder(noise, reach, reach, reach, reach, cv2.BORDER_REFLECT)
    return cv2.sepFilter2D(padded, -1, weights, weights)[reach : reach + height, reach : reach + width]


def _blown(x: Picture, radius: float, sigma: float, degrees: float) -> Picture:
    """Blur along a line, one-sided and to whole pixels, by one kernel."""
    angle, reach = np.deg2rad(degrees), 2 * int(np.ceil(radius))
    steps = np.arange(reach + 1)
    weights = np.exp(-(steps**2) / (2 * sigma**2))
    rows, columns = (np.ceil(steps * f(angle) - 0.5).astype(int) for f in (np.sin, np.cos))
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1))
    np.add.at(kernel, (reach + rows, reach + columns), weights / weights.sum())
    kernel = kernel[reach + rows.min() : reach + rows.max() + 1, reach + columns.min() : reach + columns.max() + 1]
    anchor = (int(-columns.min()), int(-rows.min()))
    return cv2.filter2D(x, -1, kernel, anchor=anchor, borderType=EDGE).reshape(x.shape)


def _magnified(x: Picture, factor: float) -> Picture:
    """The centre magnified, of the same size; square."""
    size = len(x)
    kept = int(np.ceil(size / factor))
    magnified = round(kept * factor)
    step = (kept - 1) / (magnified - 1)
    first = (size - kept) // 2 + (magnified - size) // 2 * step
    matrix, flags = np.array([[step, 0, first], [0, step, first]]), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(x, matrix, (size, size), flags=flags).reshape(x.shape)


def _opencv_warp(x: Picture, matrix: np.ndarray) -> Picture:
    return cv2.warpAffine(x, matrix, x.shape[1::-1], flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP).reshape(x.shape)


#: by the name of the corruption; called like the loops that these replace
LOOPS: dict[str, Callable[..., Picture]] = {
    **{
        f.__name__: f
        for f in (gaussian_blur, glass_blur, motion_blur, zoom_blur, snow, brightness, saturate, elastic_transform)
    },
    **{f.__name__: partial(f, warped=_opencv_warp) for f in (shear, scale, rotate, translate)},
}
