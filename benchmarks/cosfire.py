"""COSFIRE with shared maps against loops without sharing, and against a NumPy program with cached maps.

Loops use the same convolutions and blurs as the layer, so that ratios measure the gain by sharing. Agreement is checked
first; everything runs in one thread.
"""

import os
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from numpy import ndarray
from PIL import Image
from scipy.ndimage import correlate1d
from sklearn.datasets import load_digits
from torch import Tensor

from benchmarks.push_pull_timing import fastest
from sextant.errors import UserError
from sextant.layers.cosfire import BCosfire, Blur, ConcentricCircles, Cosfire, DoGBank, GaborBank, Tolerance, preset

Row = tuple[str, str, str, str, str]


def run() -> list[Row]:
    torch.set_num_threads(1)
    with torch.no_grad():
        return [*orientations(), *digits(), *vessels()]


def orientations() -> list[Row]:
    image = torch.rand(1, 1, 256, 256, generator=torch.Generator().manual_seed(0))
    options = {"blur": Blur(0.67, 0.1), "tolerance": Tolerance(36, 360.0)}
    cases = {
        "a bar, differences of Gaussians": (
            DoGBank(),
            ConcentricCircles((0, 2, 4, 6, 8), apart_deg=150),
            bar(),
            "≥ 20",
        ),
        "three bars, Gabor": (GaborBank((4.0,), 18), ConcentricCircles((0, 4, 8)), three_bars(), ""),
    }
    rows = []
    for name, (bank, circles, prototype, aim) in cases.items():
        layer = Cosfire(bank, circles, **options).configure(prototype)
        check(layer(image), one_by_one(layer, image))
        ours = fastest({"ours": lambda layer=layer: layer(image)}, 5)["ours"]
        naive = fastest({"naive": lambda layer=layer: one_by_one(layer, image)}, 1)["naive"]
        what = f"COSFIRE, 36 orientations of {name}, {len(layer.tuples(0))} parts, 256x256"
        rows.append(row(what, ours, "every part recomputed", naive, aim))
    return rows


def digits() -> list[Row]:
    scans = torch.from_numpy(load_digits().images[:64]).float()[:, None] / 16
    images = F.interpolate(scans, (28, 28), mode="bilinear")
    few, many = (configured(images, count) for count in (100, 500))
    check(few.maxima(images[:1]), one_by_one(few, images[:1]).amax((2, 3)))
    seconds = fastest({"few": lambda: few.maxima(images), "many": lambda: many.maxima(images)}, 5)
    naive = fastest({"naive": lambda: one_by_one(few, images[:1])}, 1)["naive"]
    return [
        row(
            "COSFIRE, maxima of 100 filters, an image of 64 digits",
            seconds["few"] / 64,
            "every part recomputed",
            naive,
            "≥ 10",
        ),
        ("the same of 500 filters", f"{1e6 * seconds['many'] / 64:.0f} µs an image", "", "", ""),
    ]


def vessels() -> list[Row]:
    image = vessel_image()
    batch, layer = torch.from_numpy(image)[None, None], BCosfire()
    check(layer(batch)[0], torch.from_numpy(cached_maps(image)), 1e-9)
    single = batch.float()
    seconds = fastest(
        {
            "plain": lambda: cached_maps(image),
            "double": lambda: layer(batch),
            "single": lambda: layer(single),
        },
        5,
    )
    return [
        (
            f"B-COSFIRE, both filters, {image.shape[1]}x{image.shape[0]}, {precision} precision",
            f"{1000 * seconds[precision]:.0f} ms",
            f"NumPy with cached maps, {1000 * seconds['plain']:.0f} ms",
            f"{seconds[precision] / seconds['plain']:.2f}",
            "≤ 1",
        )
        for precision in ("double", "single")
    ]


def one_by_one(layer: Cosfire, images: Tensor) -> Tensor:
    """Responses (b, n, h, w) with a convolution, a blur and a logarithm for every part of every form."""
    found = []
    height, width = images.shape[-2:]
    least = layer.t1 * layer.bank.describe(images).amax((1, 2, 3), keepdim=True)
    for number in range(len(layer)):
        best = images.new_zeros(len(images), height, width)
        for form in (layer.filter_of_form == number).nonzero()[:, 0].tolist():
            own = (layer.form == form).nonzero()[:, 0]
            total = torch.zeros_like(best)
            for part in own.tolist():
                rho, phi = float(layer.rho[part]), float(layer.phi[part])
                maps = layer.bank(images, layer.channels[part][None])
                maps = torch.where(maps >= least, maps, 0.0)
                maps = layer.blur(maps, layer.blur.sigma0 + layer.blur.alpha * rho)[:, 0]
                dx, dy = whole(rho * np.cos(phi)), whole(-rho * np.sin(phi))
                margin = max(abs(dx), abs(dy))
                wide = F.pad(maps, (margin,) * 4)
                seen = wide[:, margin + dy : margin + dy + height, margin + dx : margin + dx + width]
                total += float(layer.weights[part]) * seen.log()
            best = torch.maximum(best, total.exp())
        found.append(best)
    return torch.stack(found, 1)


def cached_maps(image: ndarray) -> ndarray:
    """Both B-COSFIRE filters for vessels of DRIVE: each difference of Gaussians and each blur once, maps rolled."""

    def line(sigma: float, reach: int) -> ndarray:
        weights = np.exp(-(np.arange(-reach, reach + 1) ** 2) / (2 * sigma**2))
        return np.asarray(weights / weights.sum())

    def smooth(values: ndarray, sigma: float, reach: int) -> ndarray:
        across = correlate1d(values, line(sigma, reach), axis=1, mode="constant")
        return np.asarray(correlate1d(across, line(sigma, reach), axis=0, mode="constant"))

    def response(sigma: float, radii: range, sigma0: float, alpha: float, turns: ndarray, sides: int) -> ndarray:
        reach = int(np.ceil(3 * sigma))
        dog = np.maximum(0, smooth(image, sigma / 2, reach) - smooth(image, sigma, reach))
        widths = {rho: (sigma0 + alpha * rho) / 6 for rho in radii}
        maps = {rho: smooth(dog, width, int(6 * width + 0.5) // 2) for rho, width in widths.items()}
        best = np.zeros_like(image)
        for turn in turns:
            product, count = maps[0].copy(), 1
            for rho in radii[1:]:
                for side in range(sides):
                    angle = np.pi / 2 + np.pi * side + turn
                    dx, dy = whole(rho * np.cos(angle)), whole(-rho * np.sin(angle))
                    product *= np.roll(maps[rho], (-dy, -dx), (0, 1))
                    count += 1
            np.maximum(best, product ** (1 / count), out=best)
        return best

    bars = response(2.4, range(0, 9, 2), 3.0, 0.7, np.pi * np.arange(12) / 12, 2)
    return bars + response(1.8, range(0, 23, 2), 2.0, 0.1, 2 * np.pi * np.arange(24) / 24, 1)


def whole(offset: float) -> int:
    near = round(float(offset), 4)
    return int(np.sign(near) * np.floor(abs(near) + 0.5))


def vessel_image() -> ndarray:
    """A retina of DRIVE, inverted, where SEXTANT_DATA has it; otherwise bright curves on noise."""
    file = Path(os.environ.get("SEXTANT_DATA", "."), "cosfire_oracle", "01_test.tif")
    if file.is_file():
        return np.asarray((255 - np.asarray(Image.open(file))[..., 1].astype(float)) / 255)
    rng = np.random.default_rng(0)
    image = rng.normal(0.4, 0.02, (584, 565))
    for start in rng.uniform(0, 565, 30):
        columns = (start + np.cumsum(rng.normal(0, 0.8, 584))).round().astype(int)
        for offset in (-1, 0, 1):
            image[np.arange(584), (columns + offset) % 565] += 0.2
    return image


def bar() -> Tensor:
    image = torch.zeros(1, 61, 61)
    image[:, :, 29:32] = 1
    return image


def three_bars() -> Tensor:
    image = torch.zeros(1, 61, 61)
    image[:, :31, 29:32] = 1
    image[:, 29:32, :] = 1
    return image


def configured(images: Tensor, count: int) -> Cosfire:
    """Filters from random places of digits."""
    generator, filters = torch.Generator().manual_seed(0), preset("digit")
    turn = 0
    while len(filters) < count:
        x, y = torch.randint(4, 24, (2,), generator=generator).tolist()
        try:
            filters.configure(images[turn % len(images)], (x, y))
        except UserError:
            continue
        finally:
            turn += 1
    return filters


def check(found: Tensor, expected: Tensor, tolerance: float = 1e-4) -> None:
    torch.testing.assert_close(found, expected, rtol=tolerance, atol=tolerance)


def row(name: str, ours: float, other: str, theirs: float, aim: str) -> Row:
    return (name, f"{1e3 * ours:.2f} ms", f"{other}, {1e3 * theirs:.1f} ms", f"{theirs / ours:.1f} times as fast", aim)
