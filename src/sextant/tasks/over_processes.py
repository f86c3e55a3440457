"""What a step needs of all processes that share its batch."""

from torch import Tensor

from sextant.data.share import Share
from sextant.layers.global_batch_norm import sum_over_processes


def over_processes(values: Tensor, count: int, share: Share) -> Tensor:
    """The rows ``(count, d)`` of a whole batch, each from the process whose share it is.

    Gradients go back to the process that a row came from, added up over the processes that used it.

    Args:
        values: of this process's share, ``(b, d)``; what a process without one gives instead counts for nothing.
        count: rows of the batch.
        share: of this process.
    """
    if share.ranks == 1:
        return values
    whole = values.new_zeros(count, values.shape[1])
    mine = share.of(whole)
    mine += values[: len(mine)]
    return sum_over_processes(whole)
