import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.data.batches import Batch, EpochBatches, ImageBatches

counts, sizes, seeds, epochs = st.integers(1, 60), st.integers(1, 10), st.integers(0, 2**31 - 1), st.integers(0, 500)


def order(count, size, seed, epoch=0):
    sampler = EpochBatches(count, size, seed)
    sampler.set_epoch(epoch)
    batches = [batch.tolist() for batch in sampler]
    assert len(batches) == len(sampler)
    return batches


@given(counts, sizes, seeds | st.none(), epochs)
def test_an_epoch_shows_every_image_once_in_batches_of_the_size_asked_for(count, size, seed, epoch):
    batches = order(count, size, seed, epoch)
    assert sorted(i for batch in batches for i in batch) == list(range(count))
    assert all(len(batch) == size for batch in batches[:-1])
    assert len(batches[-1]) == (count - 1) % size + 1


@given(counts, sizes, seeds, epochs)
def test_the_order_is_a_function_of_seed_and_epoch_whatever_came_before(count, size, seed, epoch):
    sampler = EpochBatches(count, size, seed)
    list(sampler)
    torch.rand(3)
    sampler.set_epoch(epoch)
    assert [batch.tolist() for batch in sampler] == order(count, size, seed, epoch)


def test_no_two_epochs_of_any_run_share_an_order():
    orders = {tuple(order(50, 50, seed, epoch)[0]) for seed in range(20) for epoch in range(20)}
    assert len(orders) == 400


def test_without_a_seed_images_keep_their_order_in_every_epoch():
    assert order(5, 2, None, epoch=0) == order(5, 2, None, epoch=3) == [[0, 1], [2, 3], [4]]


def test_a_batch_holds_the_images_labels_and_positions_asked_for():
    images = torch.arange(6, dtype=torch.uint8).view(6, 1, 1, 1).expand(6, 3, 2, 2)
    dataset = ImageBatches(images, 10 * torch.arange(6))
    for chosen in ([3, 1, 4], torch.tensor([3, 1, 4])):
        batch = dataset[chosen]
        assert torch.equal(batch.images, images[[3, 1, 4]])
        assert batch.labels.tolist() == [30, 10, 40]
        assert batch.indices.tolist() == [3, 1, 4]
    assert len(dataset) == 6


def test_bytes_become_the_unit_range():
    batch = Batch(torch.tensor([0, 51, 255], dtype=torch.uint8).view(3, 1, 1, 1), torch.arange(3), torch.arange(3))
    images = batch.images_in_unit_range()
    assert images.dtype == torch.float32
    torch.testing.assert_close(images.flatten(), torch.tensor([0, 0.2, 1]))


def test_a_batch_moves_as_a_whole():
    batch = ImageBatches(torch.zeros(2, 1, 1, 1, dtype=torch.uint8), torch.arange(2))[[0, 1]].to(torch.device("meta"))
    assert {tensor.device.type for tensor in (batch.images, batch.labels, batch.indices)} == {"meta"}
