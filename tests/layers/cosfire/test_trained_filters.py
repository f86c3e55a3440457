"""Filters whose parts are trained: gradients, and steps along them."""

import pytest
import torch
from layers.cosfire.cosfire_cases import Given, random_images, with_parts
from torch import nn

from sextant.layers.cosfire import (
    Blur,
    ChannelPeaks,
    Cosfire,
    DoGBank,
    FeatureBank,
    GaborBank,
    VectorBank,
    VectorKeypoints,
)

DOG = (1.2, 1.0)
PARTS = [(DOG, 0.3, 0.4), (DOG, 2.2, 1.0), ((1.6, 1.0), 2.7, 4.0), ((1.2, -1.0), 1.4, 5.5)]


def layer_of(bank=None, parts=PARTS, **options):
    options = {"blur": Blur(0.8, 0.0), "floor": 0.01, **options}
    layer = with_parts(bank or DoGBank((1.2, 1.6), (1, -1)), parts, parts[:2], **options)
    return layer.train_parts().double()


def respond(layer, names):
    """The layer as a function of images and of the parameters named."""

    def response(images, *values):
        return torch.func.functional_call(layer, dict(zip(names, values, strict=True)), (images,))

    return response


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["max", "sum"])
@pytest.mark.parametrize("mean", ["geometric", "arithmetic", "harmonic"])
def test_gradients_in_images_and_weights_are_those_of_finite_differences(kind, mean):
    layer = layer_of(blur=Blur(0.8, 0.1, kind=kind), mean=mean, border="reflect")
    images = random_images(0, 1, 1, 7, 6).requires_grad_()
    assert torch.autograd.gradcheck(respond(layer, ["weights"]), (images, layer.weights))


@pytest.mark.parametrize("mean", ["geometric", "arithmetic"])
def test_gradients_in_the_places_of_parts_are_those_of_finite_differences(mean):
    layer = layer_of(mean=mean, shift="bilinear")
    names = ["weights", "rho", "phi"]
    inputs = [random_images(0, 1, 1, 7, 6), *(getattr(layer, name) for name in names)]
    assert {name for name, _ in layer.named_parameters()} == {*names}
    assert torch.autograd.gradcheck(respond(layer, names), inputs)


@pytest.mark.slow
def test_gradients_in_vectors_are_those_of_finite_differences():
    vectors = random_images(1, 3, 4).tolist()
    parts = [(tuple(vector), rho, 1.0 + rho) for vector, rho in zip(vectors, [0.0, 1.0, 2.0], strict=True)]
    layer = Cosfire(VectorBank(nn.Identity(), 4), blur=Blur(0.8, 0.0), floor=0.01)
    layer.strategy = Given(tuple(parts))
    layer.configure(random_images(0, 4, 5, 5)).train_parts().double()
    assert {name for name, _ in layer.named_parameters()} == {"weights", "channels"}
    inputs = [random_images(2, 1, 4, 5, 6).requires_grad_(), layer.channels]
    assert torch.autograd.gradcheck(respond(layer, ["channels"]), inputs)


def test_training_changes_nothing_before_the_first_step():
    images = random_images(0, 2, 1, 9, 9)
    fixed = with_parts(DoGBank((1.2, 1.6), (1, -1)), PARTS, blur=Blur(0.8, 0.1))
    before, most = fixed(images), fixed.maxima(images)
    fixed.train_parts()
    torch.testing.assert_close(fixed(images), before, rtol=1e-6, atol=1e-9)
    torch.testing.assert_close(fixed.maxima(images), most, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("mean", ["geometric", "harmonic"])
@pytest.mark.parametrize("shift", ["whole", "bilinear"])
def test_gradients_are_finite_where_responses_are_zero(mean, shift):
    layer = layer_of(mean=mean, shift=shift, floor=0.0)
    images = torch.zeros(1, 1, 9, 9, dtype=torch.float64)
    images[..., 2, 3] = 1
    images.requires_grad_()
    response = layer(images)
    assert (response == 0).any()
    response.sum().backward()
    assert all(array.grad.isfinite().all() for array in (images, *layer.parameters()))


def test_weights_count_by_their_share_and_negative_ones_hardly():
    images = random_images(0, 1, 1, 9, 9)
    layer, twice = layer_of(), layer_of()
    twice.weights.data *= 2
    torch.testing.assert_close(twice(images), layer(images))
    layer.weights.data[0] = -1.0
    first = (with_parts(layer.bank, PARTS[1:], least_weight=1.0, blur=layer.blur, floor=layer.floor))(images)
    layer.weights.data[1:4] = 1.0
    torch.testing.assert_close(layer(images)[:, :1], first, rtol=1e-6, atol=0)


@pytest.mark.parametrize("kind", ["weights", "places", "vectors"])
def test_steps_along_the_gradient_make_a_loss_less(kind):
    if kind == "vectors":
        images, example = random_images(0, 4, 5, 12, 12), random_images(1, 5, 12, 12)
        layer = Cosfire(VectorBank(nn.Identity(), 5), VectorKeypoints(reach=5.0), floor=0.01).configure(example)
    else:
        images, example = random_images(0, 4, 1, 12, 12), random_images(1, 1, 12, 12)
        shift = "bilinear" if kind == "places" else "whole"
        layer = Cosfire(GaborBank(), shift=shift, floor=0.01).configure(example)
    layer.train_parts()
    optimizer = torch.optim.Adam(layer.parameters(), lr=0.02)

    def loss():
        found = layer.maxima(images)
        return found[:2].mean() - found[2:].mean()  # the first two images shall answer less than the others

    before = float(loss().detach())
    for _ in range(5):
        optimizer.zero_grad()
        loss().backward()
        optimizer.step()
    assert float(loss().detach()) < before


def test_of_a_bank_of_channels_nothing_but_weights_is_trained():
    layer = Cosfire(FeatureBank(nn.Identity(), 3), ChannelPeaks()).configure(random_images(0, 3, 9, 9))
    assert [name for name, _ in layer.train_parts().named_parameters()] == ["weights"]


def test_trained_layers_take_more_filters_lose_them_and_are_restored():
    layer = Cosfire(GaborBank()).configure(random_images(0, 1, 21, 21)).train_parts()
    images = random_images(1, 1, 1, 21, 21)
    layer.weights.data *= torch.linspace(0.5, 2.0, len(layer.weights))
    trained = layer(images).detach()
    layer.configure(random_images(2, 1, 21, 21))
    assert isinstance(layer.weights, nn.Parameter)
    torch.testing.assert_close(layer(images)[:, :1], trained)
    layer.drop_last()
    torch.testing.assert_close(layer(images), trained)
    fresh = Cosfire(GaborBank())
    fresh.load_state_dict(layer.state_dict())
    torch.testing.assert_close(fresh(images), trained)
    layer.keep(lambda parts: parts.rho == 0)
    assert layer(images).isfinite().all()
