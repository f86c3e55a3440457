"""What every corruption promises; its own formula is tested in its own file."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.corruptions import ContrastPoisson, GaussianNoise

CORRUPTIONS = [
    GaussianNoise([0.2]),
    GaussianNoise([0.2], clip=True),
    ContrastPoisson([0.4]),
    ContrastPoisson([0.4], clip=True),
]
every_corruption = pytest.mark.parametrize("corruption", CORRUPTIONS, ids=lambda c: f"{c.name}-{c.clip}")
every_shape = pytest.mark.parametrize("shape", [(1, 28, 28), (3, 32, 32)], ids=str)
COUNT = 6


def some_images(shape=(1, 8, 8)):
    images = torch.rand(COUNT, *shape, generator=torch.Generator().manual_seed(0))
    return images, torch.arange(100, 100 + COUNT)


@every_corruption
@every_shape
@given(order=st.lists(st.integers(0, COUNT - 1), min_size=1, max_size=COUNT, unique=True))
def test_an_image_is_corrupted_alike_in_every_batch(corruption, shape, order):
    images, indices = some_images(shape)
    together = corruption(images, corruption.levels[0], indices, seed=3)
    assert torch.equal(corruption(images[order], corruption.levels[0], indices[order], seed=3), together[order])


@every_corruption
@every_shape
def test_to_draw_and_to_apply_is_to_corrupt(corruption, shape):
    images, indices = some_images(shape)
    level = corruption.levels[0]
    drawn = corruption.draw(level, indices, shape, 3)
    assert torch.equal(corruption.apply(images, level, drawn), corruption(images, level, indices, 3))


@every_corruption
def test_another_index_or_another_seed_is_another_draw(corruption):
    images, indices = some_images()
    level = corruption.levels[0]
    reference = corruption(images, level, indices, seed=3)
    for other in (corruption(images, level, indices + COUNT, 3), corruption(images, level, indices, 4)):
        assert all(not torch.equal(a, b) for a, b in zip(reference, other, strict=True))


@every_corruption
def test_equal_images_at_different_indices_become_different(corruption):
    images, indices = some_images()
    alike = images[:1].expand(COUNT, -1, -1, -1)
    assert len(corruption(alike, corruption.levels[0], indices, 0).flatten(1).unique(dim=0)) == COUNT


@pytest.mark.parametrize(("kind", "level"), [(GaussianNoise, 0.2), (ContrastPoisson, 0.9)])
def test_clipping_moves_values_outside_the_unit_range_to_its_ends(kind, level):
    images, indices = some_images((1, 28, 28))
    images = images.round()  # black and white: noise leaves the range
    loose, clipped = (kind([level], clip=clip)(images, level, indices, 0) for clip in (False, True))
    assert loose.max() > 1
    assert torch.equal(clipped, loose.clamp(0, 1))


@every_corruption
@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float32, torch.float64])
def test_the_images_keep_their_type_and_are_not_changed_in_place(corruption, dtype):
    images, indices = some_images()
    images = images.to(dtype)
    before = images.clone()
    assert corruption(images, corruption.levels[0], indices, 0).dtype == dtype
    assert torch.equal(images, before)
