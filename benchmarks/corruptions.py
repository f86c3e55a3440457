"""Corrupted images a second on one thread: the engine against a loop over images with NumPy, SciPy, OpenCV and Pillow.

The loop is written as a user would from the definitions of CIFAR-10-C: one image in, one image out, libraries for
what they have. Every corruption runs at its five severities, draws included, on images of 32x32 pixels in colour.
"""

import time
from collections.abc import Callable
from io import BytesIO
from statistics import fmean, geometric_mean, median

import cv2
import numpy as np
import torch
from PIL import Image
from scipy import ndimage
from skimage.color import hsv2rgb, rgb2hsv
from skimage.util import random_noise

from sextant.corruptions import SEVERITIES, cifar10_c

BATCH, LOOP, REPEATS, SIZE = 128, 16, 3, 32
Picture = np.ndarray  # (32, 32, 3), float in [0, 1]
RNG = np.random.default_rng(0)


def gaussian_noise(x: Picture, sigma: float) -> Picture:
    return np.clip(x + RNG.normal(scale=sigma, size=x.shape), 0, 1)


def shot_noise(x: Picture, peak: float) -> Picture:
    return np.clip(RNG.poisson(x * peak) / peak, 0, 1)


def impulse_noise(x: Picture, amount: float) -> Picture:
    return random_noise(x, mode="s&p", amount=amount)


def speckle_noise(x: Picture, sigma: float) -> Picture:
    return np.clip(x + x * RNG.normal(scale=sigma, size=x.shape), 0, 1)


def gaussian_blur(x: Picture, sigma: float) -> Picture:
    return np.clip(ndimage.gaussian_filter(x, (sigma, sigma, 0), mode="nearest"), 0, 1)


def glass_blur(x: Picture, sigma: float, reach: int, passes: int) -> Picture:
    y = np.uint8(ndimage.gaussian_filter(x, (sigma, sigma, 0), mode="nearest") * 255)
    for _ in range(passes):
        for row in range(SIZE - reach, reach, -1):
            for column in range(SIZE - reach, reach, -1):
                dx, dy = RNG.integers(-reach, reach, 2)
                y[row, column], y[row + dy, column + dx] = y[row + dy, column + dx], y[row, column]
    return np.clip(ndimage.gaussian_filter(y / 255, (sigma, sigma, 0), mode="nearest"), 0, 1)


def defocus_blur(x: Picture, radius: float, alias: float) -> Picture:
    line = np.arange(-8, 9)
    disk = (line[:, None] ** 2 + line**2 <= radius**2).astype(np.float32)
    kernel = cv2.GaussianBlur(disk / disk.sum(), (3, 3), alias)
    return np.clip(cv2.filter2D(x, -1, kernel), 0, 1)


def motion_blur(x: Picture, radius: float, sigma: float) -> Picture:
    angle = np.deg2rad(RNG.uniform(-45, 45))
    reach = 2 * int(np.ceil(radius))
    weights = np.exp(-(np.arange(reach + 1) ** 2) / (2 * sigma**2))
    padded = np.pad(x, ((reach, reach), (reach, reach), (0, 0)), mode="edge")
    y = np.zeros_like(x)
    for i, weight in enumerate(weights / weights.sum()):
        row = reach + int(np.ceil(i * np.sin(angle) - 0.5))
        column = reach + int(np.ceil(i * np.cos(angle) - 0.5))
        y += weight * padded[row : row + SIZE, column : column + SIZE]
    return np.round(y * 255) / 255


def zoom_blur(x: Picture, end: float, step: float) -> Picture:
    factors = np.arange(1, end, step)
    total = x.copy()
    for factor in factors:
        kept = int(np.ceil(SIZE / factor))
        first = (SIZE - kept) // 2
        part = x[first : first + kept, first : first + kept]
        zoomed = ndimage.zoom(part, (factor, factor, 1), order=1)
        first = (zoomed.shape[0] - SIZE) // 2
        total += zoomed[first : first + SIZE, first : first + SIZE]
    return np.clip(total / (len(factors) + 1), 0, 1)


def brightness(x: Picture, shift: float) -> Picture:
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


def elastic_transform(x: Picture, alpha: float, sigma: float, gamma: float) -> Picture:
    x = x.astype(np.float32)
    corners = np.float32([[26, 26], [26, 6], [6, 6]])
    moved = corners + RNG.uniform(-gamma * SIZE, gamma * SIZE, (3, 2)).astype(np.float32)
    matrix = cv2.getAffineTransform(corners, moved)
    x = cv2.warpAffine(x, matrix, (SIZE, SIZE), borderMode=cv2.BORDER_REFLECT_101)
    shifts = [
        alpha
        * SIZE
        * ndimage.gaussian_filter(RNG.uniform(-1, 1, (SIZE, SIZE)), sigma * SIZE, mode="reflect", truncate=3)
        for _ in range(2)
    ]
    rows, columns = np.mgrid[:SIZE, :SIZE]
    points = np.stack([rows + shifts[1], columns + shifts[0]])
    y = [ndimage.map_coordinates(x[..., c], points, order=1, mode="reflect") for c in range(3)]
    return np.clip(np.stack(y, -1), 0, 1)


def pixelate(x: Picture, factor: float) -> Picture:
    picture, small = Image.fromarray(np.uint8(np.round(x * 255))), int(SIZE * factor)
    return (
        np.asarray(picture.resize((small, small), Image.Resampling.BOX).resize((SIZE, SIZE), Image.Resampling.BOX))
        / 255
    )


def jpeg_compression(x: Picture, quality: int) -> Picture:
    encoded = BytesIO()
    Image.fromarray(np.uint8(np.round(x * 255))).save(encoded, "JPEG", quality=quality)
    return np.asarray(Image.open(encoded)) / 255


LOOPS: dict[str, Callable[..., Picture]] = {
    f.__name__: f
    for f in (
        gaussian_noise, shot_noise, impulse_noise, defocus_blur, glass_blur, motion_blur, zoom_blur, brightness,
        contrast, elastic_transform, pixelate, jpeg_compression, speckle_noise, gaussian_blur, saturate,
    )
}  # fmt: skip


def _pictures() -> torch.Tensor:
    """Colour images with detail at all sizes ``(n, 3, 32, 32)``, eight bits deep."""
    images = np.zeros((BATCH, SIZE, SIZE, 3), np.float32)
    for size in (2, 4, 8, 16, 32):
        detail = RNG.normal(size=(BATCH, size, size, 3)).astype(np.float32)
        images += np.stack([cv2.resize(picture, (SIZE, SIZE)) for picture in detail]) / 8
    return torch.from_numpy((np.clip(images + 0.5, 0, 1) * 255).round() / 255).permute(0, 3, 1, 2).contiguous()


def _seconds_an_image(work: Callable[[], object], images: int) -> float:
    work()
    times = []
    for _ in range(REPEATS):
        began = time.process_time()
        work()
        times.append(time.process_time() - began)
    return median(times) / images


def run() -> list[tuple[str, str, str, str, str]]:
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    images, indices = _pictures(), torch.arange(BATCH)
    singles = list(images[:LOOP].permute(0, 2, 3, 1).numpy().astype(np.float64))
    rows, ratios = [], {}
    for name, corruption in cifar10_c(list(LOOPS)).items():
        loop, parameters = LOOPS[name], [row if isinstance(row, tuple) else (row,) for row in corruption.table]

        def ours(corruption=corruption) -> list[torch.Tensor]:
            return [corruption(images, level, indices, 0) for level in SEVERITIES]

        def theirs(loop=loop, parameters=parameters) -> list[Picture]:
            return [loop(x, *row) for row in parameters for x in singles]

        fast, slow = _seconds_an_image(ours, 5 * BATCH), _seconds_an_image(theirs, 5 * LOOP)
        ratios[name] = slow / fast
        aim = ">= 30" if name == "glass_blur" else ""
        rows.append((name, f"{1e6 * fast:,.0f} µs", f"loop {1e6 * slow:,.0f} µs", f"{ratios[name]:.1f}", aim))
    mean, geometric = fmean(ratios.values()), geometric_mean(ratios.values())
    return [
        *rows,
        (f"corruptions 32x32, mean of {len(ratios)}", "", f"geometric mean {geometric:.1f}", f"{mean:.1f}", ">= 10"),
    ]
