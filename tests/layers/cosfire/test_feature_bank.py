"""Filters over the feature maps of a small network."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from layers.cosfire.cosfire_cases import random_images
from torch import nn

from sextant.errors import UserError
from sextant.layers.cosfire import (
    Blur,
    ChannelPeaks,
    ConcentricCircles,
    Cosfire,
    FeatureBank,
    Tolerance,
    VectorBank,
    VectorKeypoints,
)
from sextant.models.feature_map import FeatureMap

ACROSS = ChannelPeaks(reach=20.0, t2=0.5)


class Net(nn.Module):
    """Two convolutions and a classifier."""

    def __init__(self):
        super().__init__()
        self.features = nn.Sequential(
            nn.Conv2d(3, 4, 3, padding=1), nn.ReLU(), nn.MaxPool2d(2), nn.Conv2d(4, 6, 3, padding=1)
        )
        self.head = nn.Linear(6, 2)

    def forward(self, x):
        return self.head(self.features(x).mean((2, 3)))


@pytest.fixture
def features():
    torch.manual_seed(0)
    return FeatureMap(Net(), 3, (24, 24), layer="features").requires_grad_(False).double()


def banks(features):
    return [
        (FeatureBank(features, 6), ACROSS),
        (FeatureBank(features, 6, normalise=False), ConcentricCircles((0.0, 2.0, 4.0))),
        (VectorBank(features, 6), VectorKeypoints(reach=20.0)),
    ]


@pytest.mark.parametrize("index", range(3))
@pytest.mark.parametrize("size", [(24, 24), (31, 18), (64, 50)])
def test_filters_work_on_images_of_any_size(features, index, size):
    bank, strategy = banks(features)[index]
    layer = Cosfire(bank, strategy, blur=Blur(0.5, 0.1), floor=1e-3, t1=0.1).configure(random_images(0, 3, 24, 24))
    response = layer(random_images(1, 2, 3, *size))
    assert response.shape == (2, 1, size[0] // 2, size[1] // 2)
    assert response.isfinite().all()
    assert response.max() > 0


def test_the_maps_of_channels_are_shares_of_the_images_strongest(features):
    images = random_images(0, 2, 3, 24, 24)
    maps = features(images).clamp(min=0)
    chosen = torch.tensor([[4.0], [1.0]], dtype=torch.float64)
    found = FeatureBank(features, 6)(images, chosen)
    torch.testing.assert_close(found, (maps / maps.amax((1, 2, 3), keepdim=True))[:, [4, 1]])
    assert torch.equal(FeatureBank(features, 6, normalise=False)(images, chosen), maps[:, [4, 1]])
    for normalise in (False, True):
        bank = FeatureBank(features, 6, normalise=normalise)
        torch.testing.assert_close(bank.strongest(images), bank.describe(images).amax((1, 2, 3)))


@pytest.mark.parametrize("t1", [0.0, 0.3, 0.6])
def test_weak_vectors_are_no_parts_and_strong_ones_stay_whole(features, t1):
    example = random_images(0, 3, 24, 24)
    layer = Cosfire(VectorBank(features, 6), VectorKeypoints(window=0, reach=20.0, strength=0.0, most=200), t1=t1)
    layer.configure(example)
    length = features(example[None]).clamp(min=0).norm(dim=1)
    assert len(layer.tuples(0)) == int((length >= max(t1, 1e-12) * length.max()).sum())
    layer.blur = Blur(0.0, 0.0)
    torch.testing.assert_close(layer(example[None])[0, 0, 6, 6].item(), 1.0)  # the point of interest


def test_the_maps_of_vectors_are_cosines_and_those_of_short_ones_less(features):
    images = random_images(0, 1, 3, 24, 24)
    directions = random_images(1, 3, 6)
    bank = VectorBank(features, 6, least=0.5)
    maps = features(images)[0].clamp(min=0).numpy()
    length = np.sqrt((maps**2).sum(0))
    expected = np.einsum("uk,kyx->uyx", directions, maps) / directions.norm(dim=1)[:, None, None].numpy()
    expected = expected / np.maximum(length, 0.5 * length.max())
    np.testing.assert_allclose(bank(images, directions)[0], expected, atol=1e-12)


@given(st.integers(0, 99))
def test_if_all_parts_are_the_strongest_of_their_maps_nothing_answers_more_than_the_prototypes_own_point(seed):
    maps = random_images(seed, 1, 4, 9, 9)
    maps[0, torch.arange(4), torch.tensor([1, 3, 5, 7]), torch.tensor([2, 6, 4, 1])] = 2.0  # one for each channel
    strategy = ChannelPeaks(reach=20.0, strength=1.0, apart=0.0)
    layer = Cosfire(FeatureBank(nn.Identity(), 4), strategy, blur=Blur(0.67, 0.1)).configure(maps[0], (4, 4))
    assert len(layer.tuples(0)) == 4
    response = layer(maps)[0, 0]
    assert response[4, 4] == response.max() == 1


def test_of_banks_that_cannot_be_steered_moved_forms_come_from_moved_prototypes():
    """Of an identity as network, a turned image has turned maps: so has the filter's response."""
    tolerant = {"tolerance": Tolerance(4, 360.0, reflection=True), "blur": Blur(0.67, 0.1)}
    layer = Cosfire(FeatureBank(nn.Identity(), 3), ACROSS, **tolerant).configure(random_images(0, 3, 12, 14), (5, 7))
    assert len(layer.filter_of_form) == 8
    image = random_images(1, 1, 3, 15, 10)
    turned = torch.rot90(image.flip(-1), 1, (-2, -1))
    torch.testing.assert_close(layer(turned), torch.rot90(layer(image).flip(-1), 1, (-2, -1)))
    with pytest.raises(UserError, match="each of the filter's 8 forms has its own parts"):
        layer.keep(lambda parts: parts.rho > 0)


def test_the_point_is_found_in_maps_of_another_size(features):
    """The part of a dot's brightest place points from the prototype's point to it."""
    pooled = FeatureBank(nn.AvgPool2d(4), 1)
    image = torch.zeros(1, 32, 32)
    image[:, 20:24, 8:12] = 1
    parts = Cosfire(pooled, ChannelPeaks(reach=20.0)).configure(image, (21.0, 9.0)).tuples(0)
    dx, dy = 8 // 4 - 21 // 4, 20 // 4 - 9 // 4
    torch.testing.assert_close(parts.rho, torch.tensor([dx, dy]).double().norm()[None])
    torch.testing.assert_close(parts.phi, torch.atan2(torch.tensor([-dy]).double(), torch.tensor([dx]).double()))


@pytest.mark.parametrize("index", range(3))
@pytest.mark.parametrize("size", [(1, 24, 24), (3, 1, 2)])
def test_images_that_the_network_cannot_take_are_refused_in_one_message(features, index, size):
    bank, strategy = banks(features)[index]
    layer = Cosfire(bank, strategy).configure(random_images(0, 3, 24, 24))
    for ask in (layer, layer.maxima, layer.configure):
        with pytest.raises(UserError, match="network of the COSFIRE bank cannot take images"):
            ask(random_images(1, 1, *size))


@pytest.mark.parametrize("kind", [FeatureBank, VectorBank])
def test_a_bank_of_another_size_than_its_network_is_refused(features, kind):
    with pytest.raises(ValueError, match=r"the bank expects \(b, 5, y, x\)"):
        kind(features, 5).describe(random_images(0, 1, 3, 24, 24))


def test_a_strategy_that_does_not_fit_the_bank_is_refused_in_one_message(features):
    layer = Cosfire(FeatureBank(features, 6), VectorKeypoints(reach=20.0))
    with pytest.raises(UserError, match="VectorKeypoints names channels by 6 numbers, FeatureBank by 1"):
        layer.configure(random_images(0, 3, 24, 24))
    assert len(layer) == 0


@pytest.mark.parametrize("index", range(3))
def test_an_image_without_features_has_no_response_and_finite_gradients(features, index):
    bank, strategy = banks(nn.Identity())[index]
    layer = Cosfire(bank, strategy).configure(random_images(0, 6, 24, 24)).train_parts()
    nothing = torch.zeros(1, 6, 24, 24, dtype=torch.float64, requires_grad=True)
    response = layer(nothing)
    assert not response.any()
    response.sum().backward()
    for array in (nothing, *layer.parameters()):
        assert array.grad is None or array.grad.isfinite().all()
