"""Time alternatives in turn, so that other load on the machine affects all of them."""

import ctypes
import sys
import time
from collections.abc import Callable, Mapping

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
