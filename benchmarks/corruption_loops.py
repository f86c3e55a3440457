"""The corruptions of CIFAR-10-C and ImageNet-C, one picture at a time: the baseline for timings of the engine.

Written straight from the definitions, with the libraries of the benchmark's authors: NumPy, SciPy, OpenCV, scikit-image
and Pillow (no ImageMagick). Arrays that do not depend on the picture (textures of frost) are kept in memory. Faster
calls of these libraries, where they exist, are in :mod:`benchmarks.tuned_loops`.
"""

from collections.abc import Callable
from functools import lru_cache
from io import BytesIO

import cv2
import numpy as np
from PIL import Image
from scipy import ndimage
from skimage.color import hsv2rgb, rgb2hsv
from skimage.util import random_noise

from sextant.corruptions.textures import KINDS, frost_texture

Picture = np.ndarray  # (h, w, 3), or (h, w, 1) for digits; float64 in [0, 1]
RNG = np.random.default_rng(0)
WATER, MUD = np.array([175, 238, 238]) / 255, np.array([63, 42, 20]) / 255


def gaussian_noise(x: Picture, sigma: float) -> Picture:
    return np.clip(x + RNG.normal(scale=sigma, size=x.shape), 0, 1)


def shot_noise(x: Picture, peak: float) -> Picture:
    return np.clip(RNG.poisson(x * peak) / peak, 0, 1)


def impulse_noise(x: Picture, amount: float) -> Picture:
    return random_noise(x, mode="s&p", amount=amount)


def speckle_noise(x: Picture, sigma: float) -> Picture:
    return np.clip(x + x * RNG.normal(scale=sigma, size=x.shape), 0, 1)


def gaussian_blur(x: Picture, sigma: float) -> Picture:
    return np.clip(_smooth(x, sigma), 0, 1)


def glass_blur(x: Picture, sigma: float, reach: int, passes: int, chance: float, down_only: bool) -> Picture:
    height, width, channels = x.shape
    sigmas = (sigma, 0 if down_only else sigma, 0)
    y = np.uint8(ndimage.gaussian_filter(x, sigmas, mode="nearest") * 255)
    if channels == 1:
        y = y[..., 0]  # numbers are exchanged, where colours are views and copied
    for _ in range(passes):
        for row in range(height - reach, reach, -1):
            for column in range(width - reach, reach, -1):
                if chance == 1 or RNG.random() < chance:
                    dx, dy = RNG.integers(-reach, reach, 2)
                    y[row, column], y[row + dy, column + dx] = y[row + dy, column + dx], y[row, column]
    return np.clip(ndimage.gaussian_filter(y.reshape(x.shape) / 255, sigmas, mode="nearest"), 0, 1)


def defocus_blur(x: Picture, radius: float, alias: float) -> Picture:
    reach, soft = (8, 3) if radius <= 8 else (int(radius), 5)
    line = np.arange(-reach, reach + 1)
    disk = (line[:, None] ** 2 + line**2 <= radius**2).astype(np.float32)
    kernel = cv2.GaussianBlur(disk / disk.sum(), (soft, soft), alias)
    return np.clip(cv2.filter2D(x, -1, kernel), 0, 1)


def motion_blur(x: Picture, radius: float, sigma: float) -> Picture:
    return np.round(_blown(x, radius, sigma, RNG.uniform(-45, 45)) * 255) / 255


def zoom_blur(x: Picture, end: float, step: float) -> Picture:
    factors = np.arange(1, end, step)
    return np.clip((x + sum(_magnified(x, factor) for factor in factors)) / (len(factors) + 1), 0, 1)


def snow(
    x: Picture, mean: float, spread: float, zoom: float, threshold: float, radius: float, sigma: float, mix: float
) -> Picture:
    flakes = _magnified(RNG.normal(mean, spread, (*x.shape[:2], 1)), zoom)
    flakes[flakes < threshold] = 0
    flakes = np.uint8(np.clip(flakes, 0, 1) * 255) / 255
    flakes = np.round(_blown(flakes, radius, sigma, RNG.uniform(-135, -45)) * 255) / 255
    grey = cv2.cvtColor(x.astype(np.float32), cv2.COLOR_RGB2GRAY)[..., None]
    whiter = mix * x + (1 - mix) * np.maximum(x, 1.5 * grey + 0.5)
    return np.clip(whiter + flakes + flakes[::-1, ::-1], 0, 1)


def frost(x: Picture, share: float, strength: float, shrink: float) -> Picture:
    texture = _frost(RNG.integers(len(KINDS)), shrink)
    (height, width, _), (rows, columns, _) = x.shape, texture.shape
    top, left = RNG.integers(rows - height), RNG.integers(columns - width)
    return np.clip(share * x + strength * texture[top : top + height, left : left + width], 0, 1)


@lru_cache
def _frost(kind: int, shrink: float) -> Picture:
    return cv2.resize(frost_texture(int(kind)), (0, 0), fx=shrink, fy=shrink)


def fog(x: Picture, amount: float, decay: float, map_size: int) -> Picture:
    fractal = _plasma(map_size, decay)[: x.shape[0], : x.shape[1], None]
    return np.clip((x + amount * fractal) * x.max() / (x.max() + amount), 0, 1)


def brightness(x: Picture, shift: float) -> Picture:
    if x.shape[-1] == 1:
        return np.clip(x + shift, 0, 1)
    hsv = rgb2hsv(x)
    hsv[..., 2] = np.clip(hsv[..., 2] + shift, 0, 1)
    return np.clip(hsv2rgb(hsv), 0, 1)


def saturate(x: Picture, factor: float, shift: float) -> Picture:
    hsv = rgb2hsv(x)
    hsv[..., 1] = np.clip(hsv[..., 1] * factor + shift, 0, 1)
    return np.clip(hsv2rgb(hsv), 0, 1)


def contrast(x: Picture, factor: float) -> Picture:
    mean = x.mean((0, 1))
    return np.clip((x - mean) * factor + mean, 0, 1)


def elastic_transform(x: Picture, alpha: float, sigma: float, gamma: float, unit: float) -> Picture:
    x = x.astype(np.float32)
    height, width = x.shape[:2]
    side = min(height, width) * unit
    half = min(height, width) // 3
    corners = np.float32([height // 2, width // 2] + half * np.array([[1, 1], [1, -1], [-1, -1]]))
    moved = corners + RNG.uniform(-gamma * side, gamma * side, (3, 2)).astype(np.float32)
    matrix = cv2.getAffineTransform(corners, moved)
    x = cv2.warpAffine(x, matrix, (width, height), borderMode=cv2.BORDER_REFLECT_101)
    if alpha:
        right, down = (
            alpha * side * ndimage.gaussian_filter(RNG.uniform(-1, 1, (height, width)), sigma * side, truncate=3)
            for _ in range(2)
        )
        rows, columns = np.mgrid[:height, :width]
        points = np.stack([rows + down, columns + right])
        x = np.stack([ndimage.map_coordinates(x[..., c], points, order=1, mode="reflect") for c in range(3)], -1)
    return np.clip(x, 0, 1)


def pixelate(x: Picture, factor: float) -> Picture:
    picture, (height, width) = Image.fromarray(np.uint8(np.round(x * 255))), x.shape[:2]
    small = picture.resize((int(width * factor), int(height * factor)), Image.Resampling.BOX)
    return np.asarray(small.resize((width, height), Image.Resampling.BOX)) / 255


def jpeg_compression(x: Picture, quality: int) -> Picture:
    encoded = BytesIO()
    Image.fromarray(np.uint8(np.round(x * 255))).save(encoded, "JPEG", quality=quality)
    return np.asarray(Image.open(encoded)) / 255


def spatter(
    x: Picture, mean: float, spread: float, sigma: float, threshold: float, strength: float, mud: float
) -> Picture:
    liquid = ndimage.gaussian_filter(RNG.normal(mean, spread, x.shape[:2]), sigma, mode="nearest")
    liquid[liquid < threshold] = 0
    if mud or x.shape[-1] == 1:
        cover = ndimage.gaussian_filter((liquid > threshold).astype(float), strength, mode="nearest")[..., None]
        cover[cover < 0.8] = 0
        return np.clip(x * (1 - cover) + MUD[: x.shape[-1]] * cover, 0, 1)
    levels = np.uint8(liquid * 255)
    distance = cv2.distanceTransform(255 - cv2.Canny(levels, 50, 150), cv2.DIST_L2, 5)
    near = np.uint8(cv2.blur(np.minimum(distance, 20), (3, 3)))
    relief = cv2.filter2D(cv2.equalizeHist(near), cv2.CV_8U, np.float32([[-2, -1, 0], [-1, 1, 1], [0, 1, 2]]))
    shine = levels.astype(np.float32) * cv2.blur(relief, (3, 3))
    return np.clip(x + strength * (shine / max(shine.max(), 1))[..., None] * WATER, 0, 1)


def _smooth(x: Picture, sigma: float) -> Picture:
    return ndimage.gaussian_filter(x, (sigma, sigma, 0), mode="nearest")


def _blown(x: Picture, radius: float, sigma: float, degrees: float) -> Picture:
    """Blur along a line, one-sided and to whole pixels."""
    height, width = x.shape[:2]
    angle, reach = np.deg2rad(degrees), 2 * int(np.ceil(radius))
    weights = np.exp(-(np.arange(reach + 1) ** 2) / (2 * sigma**2))
    padded = np.pad(x, ((reach, reach), (reach, reach), (0, 0)), mode="edge")
    y = np.zeros_like(x)
    for i, weight in enumerate(weights / weights.sum()):
        row = reach + int(np.ceil(i * np.sin(angle) - 0.5))
        column = reach + int(np.ceil(i * np.cos(angle) - 0.5))
        y += weight * padded[row : row + height, column : column + width]
    return y


def _magnified(x: Picture, factor: float) -> Picture:
    """The centre magnified, of the same size; square."""
    size = len(x)
    kept = int(np.ceil(size / factor))
    first = (size - kept) // 2
    zoomed = ndimage.zoom(x[first : first + kept, first : first + kept], (factor, factor, 1), order=1)
    first = (len(zoomed) - size) // 2
    return zoomed[first : first + size, first : first + size]


def _plasma(size: int, decay: float) -> Picture:
    """A diamond-square map on a torus, in [0, 1]."""
    height, step, amplitude = np.zeros((size, size)), size, 1.0
    while step > 1:
        half, shape = step // 2, (size // step, size // step)
        corners = height[::step, ::step]
        pairs = corners + np.roll(corners, -1, 0)
        centres = (pairs + np.roll(pairs, -1, 1)) / 4 + amplitude * RNG.uniform(-1, 1, shape)
        above = centres + np.roll(centres, 1, 0) + corners + np.roll(corners, -1, 1)
        beside = centres + np.roll(centres, 1, 1) + pairs
        height[half::step, half::step] = centres
        height[::step, half::step] = above / 4 + amplitude * RNG.uniform(-1, 1, shape)
        height[half::step, ::step] = beside / 4 + amplitude * RNG.uniform(-1, 1, shape)
        step, amplitude = half, amplitude / decay**2
    height -= height.min()
    return height / height.max()


#: by the name of the corruption; called with a picture, a row of the set's table, and the OPTIONS of the family
LOOPS: dict[str, Callable[..., Picture]] = {
    f.__name__: f
    for f in (
        gaussian_noise, shot_noise, impulse_noise, defocus_blur, glass_blur, motion_blur, zoom_blur, snow, frost, fog,
        brightness, contrast, elastic_transform, pixelate, jpeg_compression, speckle_noise, gaussian_blur, spatter,
        saturate,
    )
}  # fmt: skip
OPTIONS = {
    "glass_blur": ("chance", "down_only"), "frost": ("shrink",), "fog": ("map_size",), "elastic_transform": ("unit",)
}  # fmt: skip
