"""Sharing an epoch between several training processes: each takes its share of every batch."""

from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar

import torch
from numpy import ndarray
from torch import Tensor
from torch.utils.data import Dataset

Rows = TypeVar("Rows", Tensor, ndarray)


@dataclass(frozen=True)
class Share:
    """The share of one process: every ``ranks``-th image of a batch, starting at ``rank``.

    All processes draw the same batches, so an epoch is the same as for a single process.

    Attributes:
        rank: number of this process.
        ranks: number of processes.

    Example:
        >>> [Share(rank, 2).of(torch.arange(5)).tolist() for rank in (0, 1)]
        [[0, 2, 4], [1, 3]]
    """

    rank: int = 0
    ranks: int = 1

    @classmethod
    def of_trainer(cls, trainer: Any) -> Self:
        """The share of a Lightning trainer's process; the whole without a trainer."""
        return cls() if trainer is None else cls(trainer.global_rank, trainer.world_size)

    def of(self, rows: Rows) -> Rows:
        """The rows of a batch that belong to this process."""
        return rows[self.rank :: self.ranks]

    def weight(self, count: int) -> float:
        r"""Factor on a mean over this process's rows of a batch of ``count``: :math:`r \, n_r / n` with r processes.

        The mean of the processes' values is then the mean over the batch.
        """
        return len(range(self.rank, count, self.ranks)) * self.ranks / count


#: the share of a single process
WHOLE = Share()


class SharedBatches(Dataset[Any]):
    """A process's share of the batches of a dataset, weighted; its batches have a field ``weight``.

    A process without an image in a small batch gets the first image with weight 0, since all must take part in a
    step.

    Args:
        batches: maps numbers of images to a batch.
        share: of this process.
    """

    def __init__(self, batches: Dataset[Any], share: Share):
        self.batches, self.share = batches, share

    def __getitem__(self, numbers: list[int] | Tensor) -> Any:
        every = torch.as_tensor(numbers)
        mine = self.share.of(every)
        return replace(self.batches[mine if len(mine) else every[:1]], weight=self.share.weight(len(every)))
