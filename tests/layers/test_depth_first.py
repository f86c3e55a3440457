"""Layers by parts of the batch: the same responses and gradients; parts are larger where gradients are asked for."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from layers.convolution_cases import convolutions

from sextant.layers import PushPullAvgConv2d, PushPullConv2d, depth_first
from sextant.layers.depth_first import FEW_TAPS

IMAGES = torch.arange(7 * 2 * 6 * 6, dtype=torch.float32).view(7, 2, 6, 6)
WEIGHT = torch.ones(3, 2, 1, 1)


@pytest.fixture(autouse=True)
def single_images(monkeypatch):
    monkeypatch.setattr(depth_first, "TILE", 1)


def parts(images, weight=WEIGHT, stride=(2, 3)):
    """How many images each call of a layer gets; the layer's responses are checked."""
    seen = []

    def respond(x):
        seen.append(len(x))
        return x[:, :, :: stride[0], :: stride[1]] + 1

    assert torch.equal(depth_first.depth_first(respond, images, weight, stride), images[:, :, ::2, ::3] + 1)
    return seen


@pytest.mark.parametrize(("tile", "most"), [(1, 1), (2 * 3 * 6 * 4, 2), (7 * 3 * 6 * 4, 7), (2**20, 7)])
def test_each_part_makes_as_much_of_the_output_as_a_tile_holds(tile, most, monkeypatch):
    monkeypatch.setattr(depth_first, "TILE", tile)
    monkeypatch.setattr(torch, "get_num_threads", lambda: 1)
    with torch.no_grad():
        assert max(parts(IMAGES)) == most


def test_parts_are_larger_where_gradients_are_asked_for(monkeypatch):
    assert parts(IMAGES) == [7]
    monkeypatch.setattr(depth_first, "TRAINING_TILE", 3 * 72)
    monkeypatch.setattr(torch, "get_num_threads", lambda: 1)
    assert parts(IMAGES) == [3, 3, 1]


def test_the_whole_batch_is_taken_for_large_kernels_and_other_layouts():
    with torch.no_grad():
        assert parts(IMAGES, torch.ones(3, FEW_TAPS + 1, 1, 1)) == [7]
        assert parts(IMAGES.to(memory_format=torch.channels_last)) == [7]
        assert parts(IMAGES[:0]) == [0]


@given(convolutions(), st.sampled_from([PushPullConv2d, PushPullAvgConv2d]), st.booleans())
def test_responses_by_parts_are_those_of_the_batch(case, layer_type, one_each):
    conv, images = case
    alpha = [0.5 + channel for channel in range(conv.out_channels)] if one_each else 0.5
    layer = layer_type.from_conv(conv, alpha=alpha)
    with torch.no_grad():
        by_parts = layer(images)
    torch.testing.assert_close(by_parts, layer(images), rtol=0, atol=1e-12)


@given(convolutions(), st.sampled_from([PushPullConv2d, PushPullAvgConv2d]))
def test_gradients_by_parts_are_those_of_the_batch(case, layer_type):
    conv, images = case
    layer = layer_type.from_conv(conv, alpha=0.5)
    gradients = []
    for tile in (1, 2**24):
        depth_first.TRAINING_TILE = tile
        gradients.append(torch.autograd.grad(layer(images).square().sum(), [*layer.parameters()]))
    torch.testing.assert_close(*gradients, rtol=1e-9, atol=1e-9)
