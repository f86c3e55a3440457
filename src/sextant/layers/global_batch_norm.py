"""Batch normalisation with the statistics of a batch that is split over several processes."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
import torch.distributed as dist
from torch import Tensor, nn


class _Sum(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        total = x.clone(memory_format=torch.contiguous_format)
        dist.all_reduce(total)
        return total

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        return _Sum.forward(ctx, gradient)


def sum_over_processes(x: Tensor) -> Tensor:
    """Sum ``x`` over all processes; each one's gradient is the sum of the gradients in all of them."""
    return _Sum.apply(x)  # type: ignore[no-any-return]


class _Global(nn.modules.batchnorm._BatchNorm):
    """Batch normalisation by the mean and variance over all processes' images, with gradients through both.

    ``nn.SyncBatchNorm`` does the same on GPUs but refuses to run on the CPU.
    """

    def forward(self, x: Tensor) -> Tensor:
        if not self.training:
            return super().forward(x)
        axes = [0, *range(2, x.dim())]
        count = sum_over_processes(x.new_full((), x.numel() / x.shape[1], dtype=torch.float32))
        mean = sum_over_processes(x.float().sum(axes)) / count
        shape = (1, -1, *[1] * (x.dim() - 2))
        centred = x.float() - mean.view(shape)
        variance = sum_over_processes(centred.square().sum(axes)) / count
        if self.track_running_stats:
            self._follow(mean.detach(), variance.detach() * count / (count - 1))
        scale = torch.rsqrt(variance + self.eps)
        if self.affine:
            scale = scale * self.weight
        found = centred * scale.view(shape)
        return (found + self.bias.view(shape) if self.affine else found).to(x.dtype)

    @torch.no_grad()
    def _follow(self, mean: Tensor, variance: Tensor) -> None:
        assert self.running_mean is not None
        assert self.running_var is not None
        assert self.num_batches_tracked is not None
        self.num_batches_tracked += 1
        share = 1 / float(self.num_batches_tracked) if self.momentum is None else self.momentum
        self.running_mean.lerp_(mean, share)
        self.running_var.lerp_(variance, share)


class _Global1d(_Global, nn.BatchNorm1d):
    pass


class _Global2d(_Global, nn.BatchNorm2d):
    pass


GLOBAL: dict[type[nn.Module], Any] = {nn.BatchNorm1d: _Global1d, nn.BatchNorm2d: _Global2d}


@contextmanager
def global_batch_norm(network: nn.Module) -> Iterator[None]:
    """Normalise over the batches of all processes within the context; with one process this has no effect.

    Args:
        network: the network; its parameters and buffers keep their identity and names.
    """
    changed = [(module, type(module)) for module in network.modules() if type(module) in GLOBAL]
    for module, kind in changed:
        module.__class__ = GLOBAL[kind]
    try:
        yield
    finally:
        for module, kind in changed:
            module.__class__ = kind
