"""Run the steps of a layer on a few images at a time, so that intermediate results stay in the cache.

In training, where the steps keep their results for the backward pass, larger parts suffice: the gain is that memory is
reused instead of being allocated anew.
"""

from collections.abc import Callable
from itertools import chain

import torch
from torch import Tensor

TILE = 2**20  # bytes of output that each thread computes at a time
TRAINING_TILE = 2**24
FEW_TAPS = 256  # of a kernel: with more, the products dominate, and weights would be read again for each tile


def traced() -> bool:
    """Whether the network is being traced into a graph, into which nothing shape-dependent should be written."""
    return torch.compiler.is_compiling() or torch.jit.is_tracing()  # type: ignore[attr-defined]


def overwriting() -> bool:
    """Whether a layer may compute in place: nothing is kept for gradients or a graph."""
    return not torch.is_grad_enabled() and not traced()


def depth_first(respond: Callable[[Tensor], Tensor], x: Tensor, weight: Tensor, stride: tuple[int, int]) -> Tensor:
    """Compute ``respond(x)``, in parts of the batch where that is faster.

    A layer with few taps spends its time on passes over outputs larger than the cache, and on allocating memory for
    them. Each image's response must depend on that image alone.

    Args:
        respond: the layer; its output has the channels of ``weight``, and a response every ``stride`` pixels.
    """
    if traced() or weight[0].numel() > FEW_TAPS:
        return respond(x)
    if not (x.ndim == 4 and x.is_cpu and x.is_contiguous()):
        return respond(x)
    image = len(weight) * x.shape[-2] * x.shape[-1] * x.element_size() / (stride[0] * stride[1])
    tile = TILE if overwriting() else TRAINING_TILE
    parts = x.split(max(1, int(tile / image)) * torch.get_num_threads())
    if len(parts) < 2:
        return respond(x)
    if not overwriting():
        return torch.cat([respond(part) for part in parts])
    first = respond(parts[0])
    whole = first.new_empty(len(x), *first.shape[1:])
    responses = chain([first], map(respond, parts[1:]))
    for place, response in zip(whole.split(len(parts[0])), responses, strict=True):
        place.copy_(response)
    return whole
