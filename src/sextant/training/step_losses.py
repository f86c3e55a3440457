"""Training losses kept on their device and read only every few steps."""

import torch
import torch.distributed as dist
from torch import Tensor

from sextant.errors import LossNotFiniteError


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
