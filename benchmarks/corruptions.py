"""Corrupted images per second on one thread: the engine on a batch against loops over images.

Three sets at the sizes they were published for, every corruption at all severities of its set, random draws included.
The loops (:mod:`benchmarks.corruption_loops`, :mod:`benchmarks.shape_loops`) do the same image by image, with
the libraries of the benchmarks' authors; where we know a faster implementation, :mod:`benchmarks.tuned_loops` is timed
as well. All are first checked to have the same effect on the pictures.
"""

from collections.abc import Callable, Mapping
from statistics import fmean, geometric_mean
from typing import Any

import cv2
import numpy as np
import torch

from benchmarks import corruption_loops, shape_loops, tuned_loops
from benchmarks.push_pull_timing import fastest
from sextant.corruptions import BenchmarkCorruption, cifar10_c, imagenet_c, mnist_c

Row = tuple[str, str, str, str, str]
Times = Mapping[str, float]  # seconds per image and severity
Corruptions = Mapping[str, BenchmarkCorruption[Any, Any]]
AUTHORS = {**corruption_loops.LOOPS, **shape_loops.LOOPS}
KINDS = {"loop": AUTHORS, "tuned": tuned_loops.LOOPS}
AIMS = {"32x32 glass_blur": ">= 30", "32x32": ">= 10"}


def run() -> list[Row]:
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    return [
        *compare("32x32", cifar10_c(), pictures(128, 32, 3), singles=16, repeats=5, tolerance=0.1),
        *compare("28x28", mnist_c(), digits(128), singles=64, repeats=5, tolerance=0.1),
        *compare("224x224", imagenet_c(), pictures(8, 224, 3), singles=2, repeats=2, tolerance=0.2),
    ]


def pictures(count: int, size: int, channels: int) -> torch.Tensor:
    """Images with detail at all sizes ``(n, c, h, w)``, eight bits deep."""
    rng = np.random.default_rng(0)
    images = np.zeros((count, size, size, channels), np.float32)
    for power in range(1, size.bit_length()):
        detail = rng.normal(size=(count, 2**power, 2**power, channels)).astype(np.float32)
        images += np.stack([cv2.resize(picture, (size, size)).reshape(size, size, channels) for picture in detail]) / 8
    return torch.from_numpy((np.clip(images + 0.5, 0, 1) * 255).round() / 255).permute(0, 3, 1, 2).contiguous()


def digits(count: int) -> torch.Tensor:
    """Strokes of white on black, as wide as those of digits ``(n, 1, 28, 28)``."""
    rng, images = np.random.default_rng(0), np.zeros((count, 28, 28), np.uint8)
    for image in images:
        cv2.polylines(image, [rng.integers(5, 23, (4, 2), dtype=np.int32)], False, 255, 2, cv2.LINE_AA)
    return torch.from_numpy(images[:, None] / np.float32(255))


def compare(
    title: str, corruptions: Corruptions, images: torch.Tensor, singles: int, repeats: int, tolerance: float
) -> list[Row]:
    """Times per image and severity for each corruption and for the whole set."""
    rows, measured = [], []
    for name, corruption in corruptions.items():
        loops = {kind: table[name] for kind, table in KINDS.items() if name in table}
        tasks = {kind: _loop(loop, name, corruption, images[:singles]) for kind, loop in loops.items()}
        for kind, task in tasks.items():
            _check_same(f"{title} {name}, {kind}", corruption, images[:singles], task(), tolerance)
        seconds = fastest({"engine": _engine(corruption, images), **tasks}, repeats)
        counts = {"engine": len(images)}
        times = {kind: total / counts.get(kind, singles) / len(corruption.levels) for kind, total in seconds.items()}
        rows.append(_row(f"{title} {name}", times))
        measured.append({"tuned": times["loop"], **times})
    return [*rows, *_summary(title, measured)]


def _summary(title: str, measured: list[Times]) -> list[Row]:
    """Over the set: the means of the ratios, and the ratio of the means, where slow corruptions weigh more."""
    rows = []
    for kind, words, aim in (("loop", "", AIMS.get(title, "")), ("tuned", ", tuned loops", "")):
        ratios = [times[kind] / times["engine"] for times in measured]
        spread = f"geometric mean {geometric_mean(ratios):.1f}, least {min(ratios):.1f}"
        rows.append((f"{title}, mean of {len(ratios)} ratios{words}", "", spread, f"{fmean(ratios):.1f}", aim))
    whole = {kind: fmean(times[kind] for times in measured) for kind in ("engine", *KINDS)}
    return [*rows, _row(f"{title}, the whole set", whole)]


def _engine(corruption: BenchmarkCorruption[Any, Any], images: torch.Tensor) -> Callable[[], list[torch.Tensor]]:
    indices = torch.arange(len(images))
    return lambda: [corruption(images, level, indices, 0) for level in corruption.levels]


def _loop(
    loop: Callable[..., np.ndarray], name: str, corruption: BenchmarkCorruption[Any, Any], images: torch.Tensor
) -> Callable[[], list[list[np.ndarray]]]:
    one_by_one = list(images.permute(0, 2, 3, 1).double().numpy())
    rows = [corruption.row(level) for level in corruption.levels]
    arguments = [row if isinstance(row, tuple) else (row,) for row in rows]
    options = {key: getattr(corruption, key) for key in corruption_loops.OPTIONS.get(name, ())}
    return lambda: [[loop(x, *row, **options) for x in one_by_one] for row in arguments]


def _check_same(
    name: str,
    corruption: BenchmarkCorruption[Any, Any],
    images: torch.Tensor,
    theirs: list[list[np.ndarray]],
    tolerance: float,
) -> None:
    """Check that both sides do the same, without which a ratio of times is meaningless.

    Raises:
        RuntimeError: without randomness, engine and loop differ by more than 0.01 in root mean square; with it, the
            root mean square of the change, or of its steps from pixel to pixel, differs by a share above ``tolerance``.
    """
    ours = torch.stack(_engine(corruption, images)())
    loop = torch.from_numpy(np.array(theirs)).permute(0, 1, 4, 2, 3)
    if corruption.draw(corruption.levels[0], torch.arange(1), tuple(images.shape[1:]), 0) is None:
        differences = {"pictures": _size(ours - loop) / 0.01}
    else:
        changes = (ours - images, loop - images)
        pairs = {"change": changes, "steps": [change.diff(dim=-1) for change in changes]}
        differences = {key: abs(_size(a) / _size(b) - 1) / tolerance for key, (a, b) in pairs.items()}
    if max(differences.values()) > 1:
        raise RuntimeError(f"{name}: engine and loop differ, in multiples of what is allowed, by {differences}")


def _size(values: torch.Tensor) -> float:
    return values.square().mean().sqrt().item()


def _row(name: str, times: Times) -> Row:
    engine, loop = times["engine"], times["loop"]
    against = f"loop {1e6 * loop:,.0f} µs"
    if "tuned" in times:
        against += f", tuned {1e6 * times['tuned']:,.0f} µs ({times['tuned'] / engine:.1f})"
    return name, f"{1e6 * engine:,.0f} µs", against, f"{loop / engine:.1f}", AIMS.get(name, "")
