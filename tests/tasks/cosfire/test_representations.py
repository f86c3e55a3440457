"""Feature vectors in batches are those of one image after the other."""

import pytest
import torch
from torch import nn

from sextant.chapters.cosfire import representations
from sextant.chapters.cosfire.representations import feature_maps, filter_maxima, images_at_once
from sextant.layers.cosfire import Cosfire, GaborBank


@pytest.fixture
def images():
    return torch.randint(0, 256, (9, 1, 14, 12), generator=torch.Generator().manual_seed(0), dtype=torch.uint8)


@pytest.fixture
def filters(images):
    made = Cosfire(GaborBank())
    for image in images[:3]:
        made.configure(image.float() / 255)
    return made


def test_maxima_are_those_of_single_images_whatever_the_batch(filters, images, monkeypatch):
    expected = torch.cat([filters(image[None].float() / 255).amax((2, 3)) for image in images])
    for floats in (2**25, 1, 2 * len(filters.rho) * 14 * 12):
        monkeypatch.setattr(representations, "FLOATS_AT_ONCE", floats)
        told = []
        found = filter_maxima(filters, images, lambda done, total, told=told: told.append((done, total)))
        torch.testing.assert_close(found, expected, rtol=1e-5, atol=1e-6)
        assert told[-1] == (9, 9)
        assert len(told) == {2**25: 1, 1: 9}.get(floats, 5)


def test_as_many_images_as_have_room(filters, images, monkeypatch):
    size = len(filters.rho) * 14 * 12
    for room, expected in ((1, 1), (size, 1), (5 * size + 1, 5), (1000 * size, 64)):
        monkeypatch.setattr(representations, "FLOATS_AT_ONCE", room)
        assert images_at_once(filters, images) == expected


def test_whole_and_pooled_maps(images):
    convolution = nn.Conv2d(1, 4, 3)
    maps = convolution(images.float() / 255).relu()
    full, pooled = (feature_maps(convolution, images, kind) for kind in ("full", "pooled"))
    torch.testing.assert_close(full, maps.flatten(1))
    torch.testing.assert_close(pooled, maps.mean((2, 3)))
    assert not full.requires_grad
