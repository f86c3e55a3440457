"""Shares of batches: every image once, and a mean that is the batch's."""

from dataclasses import dataclass

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.data.batches import EpochBatches
from sextant.data.share import WHOLE, Share, SharedBatches


@dataclass(frozen=True)
class Numbers:
    values: torch.Tensor
    weight: float = 1.0


class Echo(torch.utils.data.Dataset):
    def __getitem__(self, numbers):
        return Numbers(torch.as_tensor(numbers))


def shares(ranks):
    return [SharedBatches(Echo(), Share(rank, ranks)) for rank in range(ranks)]


@given(st.integers(1, 60), st.integers(1, 10), st.integers(0, 2**31 - 1), st.integers(0, 500), st.integers(1, 5))
def test_an_epoch_shows_every_image_to_one_process_once(count, size, seed, epoch, ranks):
    seen = []
    for share in shares(ranks):
        sampler = EpochBatches(count, size, seed)
        sampler.set_epoch(epoch)
        seen += [value for batch in map(share.__getitem__, sampler) if batch.weight for value in batch.values.tolist()]
    assert sorted(seen) == list(range(count))


@given(st.integers(1, 20), st.integers(1, 6))
def test_the_mean_of_the_weighted_means_is_that_of_the_batch(count, ranks):
    numbers = torch.from_numpy(np.random.default_rng(count).integers(0, 1000, count))
    parts = [share[numbers] for share in shares(ranks)]
    assert np.mean([part.weight * part.values.double().mean() for part in parts]) == pytest.approx(
        numbers.double().mean()
    )


def test_a_process_alone_has_the_whole_batch_as_it_is():
    batch = SharedBatches(Echo(), WHOLE)[[5, 3, 4]]
    assert batch.values.tolist() == [5, 3, 4]
    assert batch.weight == 1.0
    assert Share.of_trainer(None) == WHOLE
