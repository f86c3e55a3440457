"""Time alternatives in turn, so that other load on the machine affects all of them."""

import ctypes
import sys
import time
from collections.abc import Callable, Collection, Mapping
from statistics import median

import torch
from torch import Tensor, nn

TRIM_THRESHOLD, MMAP_MAX = -1, -4  # of mallopt


def fastest(tasks: Mapping[str, Callable[[], object]], repeats: int = 9, *, warm: bool = True) -> dict[str, float]:
    """The least process time of each task in seconds; with ``warm``, an extra first call is not counted."""
    seconds = dict.fromkeys(tasks, float("inf"))
    for task in tasks.values() if warm else ():
        task()
    for _ in range(repeats):
        for name, task in tasks.items():
            began = time.process_time()
            task()
            seconds[name] = min(seconds[name], time.process_time() - began)
    return seconds


def medians(
    works: Mapping[str, Callable[[], object]],
    repeats: int,
    *,
    warm: int = 1,
    clock: Callable[[], float] = time.perf_counter,
    seldom: Collection[str] = (),
) -> dict[str, float]:
    """The median time of each task in seconds over ``repeats`` rounds, after ``warm`` rounds that are not counted.

    Tasks named in ``seldom``, which take long, run in every eighth round.
    """
    seconds: dict[str, list[float]] = {name: [] for name in works}
    for turn in range(-warm, repeats):
        for name, work in works.items():
            if name in seldom and turn > 0 and turn % 8:
                continue
            began = clock()
            work()
            if turn >= 0:
                seconds[name].append(clock() - began)
    return {name: median(times) for name, times in seconds.items()}


def turns(tasks: Mapping[str, Callable[[], object]], repeats: int, least: float = 0.05) -> dict[str, list[float]]:
    """Process time in seconds of each task in each of ``repeats`` turns.

    A turn of a short task is the fastest of as many calls as take ``least`` seconds.
    """
    once = fastest(tasks, repeats=1)
    seconds: dict[str, list[float]] = {name: [] for name in tasks}
    for _ in range(repeats):
        for name, task in tasks.items():
            times = fastest({name: task}, repeats=max(1, round(least / once[name])), warm=False)
            seconds[name].append(times[name])
    return seconds


def settle_allocator() -> None:
    """Let glibc keep and reuse freed memory, so that a layer's time does not depend on earlier allocations.

    By default it returns large blocks to the system, after some layers and not after others; allocating them again
    can cost more than the layer itself.
    """
    if sys.platform == "linux":
        libc = ctypes.CDLL(None)
        libc.mallopt(TRIM_THRESHOLD, 2**31 - 1)
        libc.mallopt(MMAP_MAX, 0)


def forward_pass(layer: Callable[[Tensor], Tensor], images: Tensor) -> Callable[[], object]:
    def run() -> None:
        with torch.no_grad():
            layer(images)

    return run


def training_step(layer: nn.Module, images: Tensor) -> Callable[[], object]:
    """Forward and backward pass; the gradients are dropped."""

    def run() -> None:
        images.grad = None
        layer.zero_grad(set_to_none=True)
        layer(images).sum().backward()

    return run
