"""A layer of a network as a descriptor: against its formula, and what it does to sizes and colours."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from sklearn.exceptions import NotFittedError
from torch import nn

from sextant.baselines.network_layer import BATCH, NetworkLayer
from sextant.errors import ArgumentError

IMAGES = np.random.default_rng(0).integers(0, 256, (BATCH + 6, 8, 12, 3)).astype(np.uint8)


def convolution(channels=3):
    torch.manual_seed(0)
    return nn.Conv2d(channels, 5, 3, padding=1)


@given(rows=st.integers(1, 8), columns=st.integers(1, 12))
def test_it_is_the_mean_over_cells_at_unit_length(rows, columns):
    layer = NetworkLayer(nn.Identity(), 8, 12, grid=(rows, columns))
    image = IMAGES[3].astype(float) / 255
    edges = [[(k * size // n, -(-(k + 1) * size // n)) for k in range(n)] for n, size in ((rows, 8), (columns, 12))]
    means = [
        [[image[top:bottom, left:right, c].mean() for left, right in edges[1]] for top, bottom in edges[0]]
        for c in range(3)
    ]
    expected = np.ravel(means)
    np.testing.assert_allclose(layer.describe(IMAGES[3:4])[0], expected / np.linalg.norm(expected), rtol=1e-5)


def test_a_map_smaller_than_the_grid_keeps_its_cells():
    layer = NetworkLayer(nn.AvgPool2d(4), 8, 12, grid=(4, 8))
    assert layer.describe(IMAGES[:2]).shape == (2, 3 * 2 * 3)


def test_images_are_described_alike_alone_and_among_others():
    layer = NetworkLayer(convolution(), 8, 12, grid=(2, 3))
    together = layer.describe(IMAGES)
    assert together.shape == (BATCH + 6, 30)
    np.testing.assert_allclose(np.linalg.norm(together, axis=1), 1, atol=1e-5)
    for i in (0, BATCH - 1, BATCH, BATCH + 5):
        np.testing.assert_allclose(layer.describe(IMAGES[i : i + 1])[0], together[i], atol=1e-6)


def test_images_that_cannot_be_written_to_are_described():
    layer, locked = NetworkLayer(convolution(), 8, 12, grid=(2, 3)), IMAGES[:2].copy()
    locked.flags.writeable = False
    np.testing.assert_array_equal(layer.describe(locked), layer.describe(IMAGES[:2]))


def test_sizes_and_colours_become_those_of_the_network():
    colour, grey = NetworkLayer(convolution(), 4, 6, grid=(2, 2)), NetworkLayer(convolution(1), 4, 6, channels=1)
    one = IMAGES[:3, ..., :1]
    np.testing.assert_allclose(colour.describe(one), colour.describe(one.repeat(3, -1)), atol=1e-6)
    np.testing.assert_allclose(
        colour.describe(one), colour.describe_grey(one[..., 0].astype(np.float32) / 255), atol=1e-6
    )
    np.testing.assert_allclose(grey.describe(one), grey.describe(one.repeat(3, -1)), atol=1e-5)
    flat = np.full((1, 8, 12, 3), 90, np.uint8)
    np.testing.assert_allclose(colour.describe(flat), colour.describe(flat[:, :4, :6]), atol=1e-6)


def test_whitening_is_the_singular_value_decomposition_of_the_centred_rows():
    smooth = IMAGES[:40].copy()
    layer = NetworkLayer(nn.Identity(), 8, 12, grid=(8, 12), dimensions=10).fit(smooth)
    rows = smooth.transpose(0, 3, 1, 2).reshape(40, -1) / 255
    u, _, _ = np.linalg.svd(rows - rows.mean(0), full_matrices=False)
    expected = u[:, :10] / np.linalg.norm(u[:, :10], axis=1, keepdims=True)
    found = layer.describe(smooth)
    np.testing.assert_allclose(found @ found.T, expected @ expected.T, atol=1e-3)


def test_whitening_needs_images_and_a_fit():
    layer = NetworkLayer(convolution(), 8, 12, dimensions=12)
    with pytest.raises(NotFittedError):
        layer.describe(IMAGES[:2])
    with pytest.raises(ValueError, match="dimensions=12 needs more reference images than that; got 12"):
        layer.fit(IMAGES[:12])
    with pytest.raises(ValueError, match="dimensions=40, but a descriptor has only 5 numbers"):
        NetworkLayer(convolution(), 8, 12, grid=(1, 1), dimensions=40).fit(IMAGES)


def test_the_network_is_used_as_it_is():
    network = nn.Sequential(convolution(), nn.BatchNorm2d(5), nn.Dropout(0.9))
    layer = NetworkLayer(network, 8, 12)
    first = layer.describe(IMAGES[:4])
    assert np.array_equal(layer.describe(IMAGES[:4]), first)
    assert not any(parameter.requires_grad for parameter in network.parameters())
    assert network[1].num_batches_tracked == 0


@pytest.mark.parametrize("wrong", [{"channels": 2}, {"grid": (0, 3)}])
def test_what_has_no_meaning_is_refused(wrong):
    with pytest.raises(ArgumentError, match=f"{next(iter(wrong))}=.* must be"):
        NetworkLayer(nn.Identity(), 8, 12, **wrong)
