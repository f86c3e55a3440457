"""The first stage of a network: after its stem and before the next change of resolution."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress

import torch
from torch import Tensor, nn

PROBE_SIDE = 128


def first_stage_convs(network: nn.Module) -> list[str]:
    """Paths of the convolutions of the first stage, except 1x1 ones, in the order in which they run.

    The *stem* is found by walking down from the network into the child that holds the first convolution, until its
    convolutions all work at one resolution. The first stage is the unbroken run of convolutions after the stem whose
    outputs have the same resolution; 1x1 convolutions are ignored. It is thus ``layer1`` of a ResNet, the 3x3
    convolutions of the first block of a DenseNet, the first inverted residual of a MobileNet, the second convolution of
    VGG, and the second of AlexNet.

    The resolutions are recorded in one run on an empty image, in evaluation mode. An error after the first stage, such
    as in a classifier for another image size, is ignored.

    >>> from sextant.models import ResNetCifar
    >>> first_stage_convs(ResNetCifar(3, (32, 32), 10))[:2]
    ['layer1.0.conv1', 'layer1.0.conv2']

    Raises:
        ValueError: there is no such convolution.
    """
    runs = _resolutions(network)
    convs = [(path, resolution) for path, resolution, kernel in runs if kernel != (1, 1)]
    if convs:
        stem = _stem(network, convs)
        after = [(path, resolution) for path, resolution in convs if not _holds(stem, path)]
        if after:
            end = next((i for i, (_, resolution) in enumerate(after) if resolution != after[0][1]), len(after))
            return list(dict.fromkeys(path for path, _ in after[:end]))
    raise ValueError(f"{type(network).__name__} has no convolution larger than 1x1 after its stem")


def _stem(network: nn.Module, convs: list[tuple[str, tuple[int, ...]]]) -> str:
    first, resolution = convs[0]
    parts = first.split(".")
    for depth in range(1, len(parts)):
        path = ".".join(parts[:depth])
        inside = [other for other, _ in convs if _holds(path, other)]
        if len(inside) < len(convs) and all(size == resolution for other, size in convs if _holds(path, other)):
            return path
    return first


def _holds(outer: str, path: str) -> bool:
    return path == outer or path.startswith(f"{outer}.")


def _resolutions(network: nn.Module) -> list[tuple[str, tuple[int, ...], tuple[int, ...]]]:
    """Path, output resolution and kernel of each convolution, in the order in which they run."""
    runs: list[tuple[str, tuple[int, ...], tuple[int, ...]]] = []
    convs = [(path, module) for path, module in network.named_modules() if isinstance(module, nn.Conv2d)]
    if not convs:
        return runs

    def record(path: str, conv: nn.Conv2d) -> torch.utils.hooks.RemovableHandle:
        def hook(module: nn.Module, inputs: tuple[Tensor, ...], output: Tensor) -> None:
            runs.append((path, tuple(output.shape[-2:]), conv.kernel_size))

        return conv.register_forward_hook(hook)

    hooks = [record(path, conv) for path, conv in convs]
    first = convs[0][1]
    image = torch.zeros(
        1, first.in_channels, PROBE_SIDE, PROBE_SIDE, dtype=first.weight.dtype, device=first.weight.device
    )
    try:
        # a network's head may reject the image: the records up to there suffice; otherwise the caller raises an error
        with suppress(RuntimeError, ValueError, AssertionError), evaluating(network), torch.no_grad():
            network(image)
    finally:
        for handle in hooks:
            handle.remove()
    return runs


@contextmanager
def evaluating(network: nn.Module) -> Iterator[None]:
    """Put the network in evaluation mode within the context; afterwards every module has its own mode back."""
    modes = {module: module.training for module in network.modules()}
    network.eval()
    try:
        yield
    finally:
        for module, mode in modes.items():
            module.training = mode
