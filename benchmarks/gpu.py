"""Training steps per second on a GPU: by precision and ``torch.compile``, against float32 on the CPU.

Images are on the device: the network, its loss and the optimiser are timed, without reading data.
"""

import time
from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

#: seconds of timing for each, after steps that warm up kernels and the compiler
TIMED_S, WARM_STEPS = 2.0, 5
PRECISIONS = {"32": None, "bf16": torch.bfloat16, "16": torch.float16}


def networks() -> dict[str, tuple[Callable[[], nn.Module], tuple[int, ...], bool]]:
    """By name: the constructor of a network, its batch shape, and whether it classifies rather than regresses."""
    from sextant.layers import PushPullConv2d
    from sextant.models import EfficientNetLite0, ResNetCifar, SmallVGG, StridedCNN

    def push_pull() -> nn.Module:
        network = ResNetCifar(3, (32, 32), 10, depth=20)
        network.conv1 = PushPullConv2d(3, 16, 3, padding=1, bias=False)
        return network

    def trunk() -> nn.Module:  # of zoo:calibration
        network = EfficientNetLite0(3, (112, 112), 256, stages=5, grid=(7, 7), frozen_stages=2)
        return network.to(memory_format=torch.channels_last)

    return {
        "ResNet-20, 32x32": (lambda: ResNetCifar(3, (32, 32), 10, depth=20), (256, 3, 32, 32), True),
        "ResNet-20 with push-pull, 32x32": (push_pull, (256, 3, 32, 32), True),
        "small VGG, 28x28": (lambda: SmallVGG(1, (28, 28), 10), (256, 1, 28, 28), True),
        "strided CNN of calibration, 96x72": (lambda: StridedCNN(3, (72, 96), 256), (64, 3, 72, 96), False),
        "EfficientNet-Lite0 of calibration, 112x112": (trunk, (64, 3, 112, 112), False),
    }


def steps_per_s(network: nn.Module, images: Tensor, *, classes: bool, half: torch.dtype | None) -> float:
    """Training steps per second."""
    optimizer = torch.optim.SGD(network.parameters(), lr=1e-3)
    scaler = torch.amp.GradScaler(images.device.type, enabled=half is torch.float16)
    labels = torch.zeros(len(images), dtype=torch.int64, device=images.device)

    def step() -> None:
        with torch.autocast(images.device.type, half or torch.bfloat16, enabled=half is not None):
            found = network(images)
            loss = nn.functional.cross_entropy(found, labels) if classes else found.square().mean()
        optimizer.zero_grad()
        scaler.scale(loss).backward()
        scaler.step(optimizer)
        scaler.update()

    def done() -> float:
        if images.is_cuda:
            torch.cuda.synchronize()
        return time.perf_counter()

    for _ in range(WARM_STEPS):
        step()
    began, count = done(), 0
    while (elapsed := done() - began) < TIMED_S:
        step()
        count += 1
    return count / elapsed


def run(
    device: str = "cuda", until: float = float("inf"), precisions: Sequence[str] = tuple(PRECISIONS)
) -> list[tuple[str, str, str, str, str]]:
    """A row for each network, precision and compilation that could be timed before ``until`` on the monotonic clock."""
    rows = []
    for name, (build, shape, classes) in networks().items():
        torch.manual_seed(0)
        images = torch.rand(shape)
        on_cpu = steps_per_s(build(), images, classes=classes, half=None)
        for precision in precisions:
            for compiled in (False, True):
                if time.monotonic() > until:
                    return rows
                network = build().to(device)
                if compiled:
                    network.compile()
                found = steps_per_s(network, images.to(device), classes=classes, half=PRECISIONS[precision])
                how = f"{precision}{', compiled' if compiled else ''}"
                measured, against = (f"{shape[0] * rate:,.0f} images/s" for rate in (found, on_cpu))
                rows.append((name, how, measured, f"CPU, 32: {against}", f"{found / on_cpu:.1f}"))
    return rows
