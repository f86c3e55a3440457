"""Crops per second on one thread: against remapping with ready maps, and against py360convert doing the same crops."""

import math
import time
from collections.abc import Callable

import cv2
import numpy as np
import torch

from benchmarks.push_pull_timing import medians
from sextant.chapters.calibration.data import CameraDistribution, CameraDraw, Panoramas
from sextant.chapters.calibration.data.crops import Sampling, crop_batch
from sextant.chapters.calibration.data.rays import Rays
from sextant.geometry import CameraParameters

COUNT, REPEATS, ROWS = 64, 7, 512
LOPEZ = CameraDistribution(
    tilt={"kind": "normal", "mean": 0.023, "std": 0.3, "low": -0.6, "high": 0.6},
    roll={"kind": "cauchy", "location": 0, "scale": 0.1, "low": -0.75, "high": 0.75},
    focal={"kind": "uniform", "low": 13, "high": 38},
    k1={"kind": "uniform", "low": -0.4, "high": 0},
    aspect={"4:3": 1},
)


def _rates(works: dict[str, Callable[[], object]], repeats: int = REPEATS) -> dict[str, float]:
    """Crops per second of each task of ``COUNT`` crops."""
    return {name: COUNT / seconds for name, seconds in medians(works, repeats, clock=time.process_time).items()}


def _panorama() -> np.ndarray:
    """A picture with detail at all sizes."""
    rng = np.random.default_rng(0)
    image = np.zeros((ROWS, 2 * ROWS, 3), np.float32)
    for size in (4, 16, 64, 256):
        image += cv2.resize(rng.normal(size=(size, 2 * size, 3)).astype(np.float32), (2 * ROWS, ROWS)) * 40
    return np.clip(image + 128, 0, 255).astype(np.uint8)


def _ready(
    panorama: np.ndarray, draw: CameraDraw, width: int, height: int, side: int
) -> dict[str, Callable[[], object]]:
    """Remapping alone, with precomputed maps: three channels with the fastest maps, and four."""
    rays = Rays.of(draw, "lopez")
    level = Panoramas([panorama], ["a"]).level(0, 0)
    three = np.ascontiguousarray(level[..., :3])
    maps = []
    for i in range(COUNT):
        x, y = rays.points(i, 2 * ROWS, ROWS, side * width, side * height)
        maps.append((x.copy(), y.copy(), *cv2.convertMaps(x, y, cv2.CV_16SC2)))

    def averaged(picture: np.ndarray) -> np.ndarray:
        return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA) if side > 1 else picture

    return {
        "three": lambda: [averaged(cv2.remap(three, a, b, cv2.INTER_LINEAR)) for _, _, a, b in maps],
        "float": lambda: [averaged(cv2.remap(three, x, y, cv2.INTER_LINEAR)) for x, y, _, _ in maps],
        "four": lambda: [averaged(cv2.remap(level, x, y, cv2.INTER_LINEAR)) for x, y, _, _ in maps],
    }


def _py360convert(panorama: np.ndarray, draw: CameraDraw, size: int) -> Callable[[], object] | None:
    try:
        import py360convert
    except ImportError:
        return None
    tilt, roll, focal, _ = (value.tolist() for value in draw.cameras)
    views = [
        (math.degrees(2 * math.atan(0.5 / f)), math.degrees(y), math.degrees(t), math.degrees(r))
        for f, y, t, r in zip(focal, draw.yaw.tolist(), tilt, roll, strict=True)
    ]
    turn = iter(range(10**6))

    def work() -> object:
        shift = 0.01 * next(turn)  # it caches the maps of earlier views
        return [py360convert.e2p(panorama, (f, f), y + shift, t, (size, size), r) for f, y, t, r in views]

    return work


def run() -> list[tuple[str, str, str, str, str]]:
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    panorama = _panorama()
    held, which = Panoramas([panorama], ["a"]), np.zeros(COUNT, np.int64)
    drawn = LOPEZ.draw(COUNT, 0)
    square = CameraDraw(drawn.cameras, drawn.yaw, torch.ones_like(drawn.aspect))
    straight = CameraDraw(CameraParameters(*drawn.cameras[:3], 0 * drawn.cameras.k1), drawn.yaw, square.aspect)
    rows = []

    works = {"ours": lambda: crop_batch(held, which, square, 224, 224, antialias=False)}
    works |= _ready(panorama, square, 224, 224, 1)
    rates = _rates(works)
    rows += _against("crops 224x224, central rays", rates, ">= 0.15")

    # one focal length, so that every crop has the same number of rays
    near = square.cameras._replace(focal=torch.full_like(square.cameras.focal, 0.9))
    even = CameraDraw(near, square.yaw, square.aspect)
    side = int(Sampling.of(Rays.of(even, "lopez"), np.full(COUNT, ROWS), 224, 224).side[0])
    works = {"ours": lambda: crop_batch(held, which, even, 224, 224)} | _ready(panorama, even, 224, 224, side)
    rows += _against(f"crops 224x224, {side} x {side} rays per pixel", _rates(works), ">= 0.5")
    far = even.cameras._replace(focal=torch.full_like(near.focal, 0.5))
    wide = CameraDraw(far, square.yaw, torch.full_like(square.aspect, 4 / 3))
    side = int(Sampling.of(Rays.of(wide, "lopez"), np.full(COUNT, ROWS), 96, 72).side[0])
    works = {"ours": lambda: crop_batch(held, which, wide, 96, 72)} | _ready(panorama, wide, 96, 72, side)
    rows += _against(f"crops 96x72, {side} x {side} rays per pixel", _rates(works), ">= 0.5")

    theirs = _py360convert(panorama, straight, 224)
    if theirs is None:
        rows.append(("crops 224x224 without distortion", "", "py360convert is not installed", "", ">= 4"))
    else:
        ours = _rates({"ours": lambda: crop_batch(held, which, straight, 224, 224, antialias=False)})["ours"]
        other = _rates({"theirs": theirs}, 3)["theirs"]
        rows.append((
            "crops 224x224 without distortion", f"{ours:,.0f} per second", f"py360convert {other:,.0f}",
            f"{ours / other:.1f}", ">= 4",
        ))  # fmt: skip

    numbers = iter(range(10**6))

    def end_to_end() -> object:
        draw = LOPEZ.draw_for(which, np.arange(COUNT) + COUNT * next(numbers), 0)
        return crop_batch(held, which, draw, 96, 72)

    rate = _rates({"ours": end_to_end})["ours"]
    rows.append(("crops 96x72 antialiased, cameras drawn", f"{rate:,.0f} per second", "", "", ">= 2,000"))
    return rows


def _against(what: str, rates: dict[str, float], aim: str) -> list[tuple[str, str, str, str, str]]:
    names = {"three": "ready maps, 3 channels, fixed point", "float": "ready maps, 3 channels, float",
             "four": "ready maps, 4 channels, float"}  # fmt: skip
    return [
        (
            what,
            f"{rates['ours']:,.0f} per second",
            f"{names[key]}: {rates[key]:,.0f}",
            f"{rates['ours'] / rates[key]:.2f}",
            aim,
        )
        for key in names
    ]
