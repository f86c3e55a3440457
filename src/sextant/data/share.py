"""Several processes train on one epoch: each takes its share of every batch."""

from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar

import torch
from numpy import ndarray
from torch import Tensor
from torch.utils.data import Dataset

Rows = TypeVar("Rows", Tensor, ndarray)


@dataclass(frozen=True)
class Share:
    """Every ``ranks``-th image of a batch, which no other process takes.

    All processes draw the same batches, so an epoch is the one that a single process sees.

    Attributes:
        rank: number of this process.
        ranks: how many there are.

    Example:
        >>> [Share(rank, 2).of(torch.arange(5)).tolist() for rank in (0, 1)]
        [[0, 2, 4], [1, 3]]
    """

    rank: int = 0
    ranks: int = 1

    @classmethod
    def of_trainer(cls, trainer: Any) -> Self:
        """That of a Lightning trainer's process; the whole without a trainer."""
        return cls() if trainer is None else cls(trainer.global_rank, trainer.world_size)

    def of(self, rows: Rows) -> Rows:
        """The rows of a batch that are this process's."""
        return rows[self.rank :: self.ranks]

    def weight(self, count: int) -> float:
        r"""Factor on a mean over this process's rows of a batch of ``count``: :math:`r \, n_r / n` with r processes.

        The mean of the processes' values is then the mean over the batch.
        """
        return len(range(self.rank, count, self.ranks)) * self.ranks / count


#: what a process without others takes
WHOLE = Share()


class SharedBatches(Dataset[Any]):
    """The share of a process in the batches of a dataset, weighted; its batches have a field ``weight``.

    A process for which a small batch has no image gets the first with weight 0, since all take part in a step.

    Args:
        batches: gives a batch for the numbers of its images.
        share: of this process.
    """

    def __init__(self, batches: Dataset[Any], share: Share):
        self.batches, self.share = batches, share

    def __getitem__(self, numbers: list[int] | Tensor) -> Any:
        every = torch.as_tensor(numbers)
        mine = self.share.of(every)
        return replace(self.batches[mine if len(mine) else every[:1]], weight=self.share.weight(len(every)))
