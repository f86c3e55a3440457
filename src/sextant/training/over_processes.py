"""Gathering the values of a batch from all processes that share it."""

from torch import Tensor

from sextant.data.share import Share
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
