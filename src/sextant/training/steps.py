"""Training losses kept on their device and read only every few steps."""

import torch
import torch.distributed as dist
from torch import Tensor

from sextant.data.share import Share
from sextant.errors import LossNotFiniteError
from sextant.layers.global_batch_norm import sum_over_processes


def over_processes(values: Tensor, count: int, share: Share) -> Tensor:
    """Gather the rows ``(count, d)`` of a whole batch, each from the process whose share it is in.

    Gradients flow back to the process that a row came from, summed over the processes that used it.

    Args:
        values: of this process's share, ``(b, d)``; values of a process without a share are ignored.
        count: number of rows of the batch.
        share: of this process.
    """
    if share.ranks == 1:
        return values
    whole = values.new_zeros(count, values.shape[1])
    mine = share.of(whole)
    mine += values[: len(mine)]
    return sum_over_processes(whole)


class StepLosses:
    """A buffer of the last ``every`` losses, which saves a transfer and a logging call at each step.

    Args:
        every: number of steps considered together.
    """

    def __init__(self, every: int):
        self.every = every
        self._losses: list[Tensor] = []
        self._first_step = 0

    def add(self, step: int, loss: Tensor) -> float | None:
        """Record the loss of ``step``; every ``every`` steps, return the mean of those since the last return.

        Raises:
            LossNotFiniteError: one of them was not finite; the message names the first such step.
        """
        if not self._losses:
            self._first_step = step
        self._losses.append(loss.detach())
        return self.flush() if len(self._losses) >= self.every else None

    def flush(self) -> float | None:
        """The mean of the losses recorded since the last return, over all training processes; None if there are none.

        Raises:
            LossNotFiniteError: as :meth:`add`.
        """
        if not self._losses:
            return None
        losses = torch.stack(self._losses).float()
        self._losses = []
        if dist.is_available() and dist.is_initialized():
            dist.all_reduce(losses)
            losses /= dist.get_world_size()
        broken = torch.nonzero(~torch.isfinite(losses))
        if len(broken):
            first = int(broken[0])
            raise LossNotFiniteError.at(self._first_step + first, float(losses[first]))
        return float(losses.mean())
