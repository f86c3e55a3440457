"""Push-pull against its equation written out anew in numpy, and against the convolution that it becomes at h = 1."""

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from hypothesis import given
from hypothesis import strategies as st
from torch import nn

from sextant.layers import PushPullConv2d, pull_kernel_size, push_pull, upsample_kernel

NUMPY_BORDER = {"zeros": "constant", "reflect": "reflect", "replicate": "edge", "circular": "wrap"}
scales = st.floats(1.0, 2.5)
alphas = st.floats(0.0, 3.0)


@st.composite
def convolutions(draw):
    """A convolution of any geometry, and images for it."""
    torch.manual_seed(draw(st.integers(0, 99)))
    groups = draw(st.integers(1, 2))
    stride = draw(st.tuples(st.integers(1, 3), st.integers(1, 3)))
    paddings = st.tuples(st.integers(0, 2), st.integers(0, 2)) | st.sampled_from(["same", "valid"])
    if stride != (1, 1):
        paddings = paddings.filter(lambda padding: padding != "same")
    conv = nn.Conv2d(
        groups * draw(st.integers(1, 2)),
        groups * draw(st.integers(1, 2)),
        draw(st.tuples(st.sampled_from([1, 3, 5]), st.sampled_from([1, 3, 5]))),
        stride,
        draw(paddings),
        draw(st.tuples(st.integers(1, 2), st.integers(1, 2))),
        groups,
        draw(st.booleans()),
        draw(st.sampled_from(list(NUMPY_BORDER))),
        dtype=torch.float64,
    )
    height, width = draw(st.tuples(st.integers(13, 16), st.integers(13, 16)))
    return conv, torch.randn(2, conv.in_channels, height, width, dtype=torch.float64)


def stretched(kernels, scale):
    """Bilinear stretching as two products with hat functions whose outermost peaks lie on the corners."""

    def hats(side):
        wide = int(side * scale) if int(side * scale) % 2 else int(side * scale) + 1
        positions = np.linspace(0, side - 1, wide)
        return np.maximum(0, 1 - np.abs(positions[:, None] - np.arange(side)))

    return np.einsum("Kk,ockl,Ll->ocKL", hats(kernels.shape[2]), kernels, hats(kernels.shape[3]))


def direct_response(conv, images, scale, alpha):
    """The equation of the paper: two convolutions of images whose border numpy has filled."""
    weight = conv.weight.detach().numpy()
    border = {"valid": (0, 0), "same": [d * (k // 2) for d, k in zip(conv.dilation, conv.kernel_size, strict=True)]}
    padding = conv.padding if isinstance(conv.padding, tuple) else border[conv.padding]

    def rectified(sign, kernels):
        growth = [big // 2 - small // 2 for big, small in zip(kernels.shape[2:], conv.kernel_size, strict=True)]
        margins = [(p + d * g,) * 2 for p, d, g in zip(padding, conv.dilation, growth, strict=True)]
        padded = np.pad(images.numpy(), [(0, 0), (0, 0), *margins], mode=NUMPY_BORDER[conv.padding_mode])
        bias = None if conv.bias is None else sign * conv.bias
        kernels = torch.from_numpy(sign * kernels)
        return F.relu(F.conv2d(torch.from_numpy(padded), kernels, bias, conv.stride, 0, conv.dilation, conv.groups))

    return rectified(1, weight) - alpha.view(-1, 1, 1) * rectified(-1, stretched(weight, scale))


def response_and_gradients(layer, images):
    images = images.clone().requires_grad_()
    response = layer(images)
    direction = torch.linspace(-1, 1, response.numel(), dtype=response.dtype).view_as(response)
    return response, *torch.autograd.grad((response * direction).sum(), [images, *layer.parameters()])


@pytest.mark.parametrize(
    ("size", "scale", "pull"),
    [(3, 2.0, 7), (5, 2.0, 11), (7, 2.0, 15), (3, 1.5, 5), (1, 2.0, 3), (3, 1.0, 3), (4, 1.0, 4)],
)
def test_pull_kernels_have_the_papers_sizes(size, scale, pull):
    assert pull_kernel_size(size, scale) == pull


@given(st.sampled_from([1, 3, 5, 7, 9, 11]), st.floats(1.0, 4.0))
def test_a_pull_kernel_is_odd_and_within_one_of_the_stretched_size(size, scale):
    pull = pull_kernel_size(size, scale)
    assert pull % 2 == 1
    assert abs(pull - size * scale) <= 1


@given(st.integers(0, 99), st.tuples(st.sampled_from([1, 3, 5]), st.sampled_from([1, 3, 5])), st.floats(1.7, 3.0))
def test_stretching_is_bilinear_with_aligned_corners(seed, sides, scale):
    kernels = np.random.default_rng(seed).normal(size=(2, 3, *sides))
    np.testing.assert_allclose(upsample_kernel(torch.from_numpy(kernels), scale), stretched(kernels, scale), atol=1e-12)


@given(convolutions(), st.floats(1.7, 2.5), alphas)
def test_the_response_is_the_papers_equation(case, scale, alpha):
    conv, images = case
    strengths = torch.linspace(0.5, 1.5, conv.out_channels, dtype=torch.float64) * alpha
    layer = PushPullConv2d.from_conv(conv, scale=scale, train_alpha=True)
    nn.init.zeros_(layer.alpha).data += strengths
    torch.testing.assert_close(layer(images), direct_response(conv, images, scale, strengths), rtol=0, atol=1e-11)


def test_a_dark_dot_inhibits_the_reach_of_the_pull_kernel_and_a_bright_dot_nothing():
    dot = torch.zeros(1, 1, 5, 5)
    dot[..., 2, 2] = 1
    reach = torch.zeros(1, 1, 5, 5)
    reach[..., 1:4, 1:4] = 1
    identity = torch.ones(1, 1, 1, 1)  # its pull kernel is a 3x3 box of ones
    assert torch.equal(push_pull(dot, identity, alpha=0.5), dot)
    assert torch.equal(push_pull(-dot, identity, alpha=0.5), -0.5 * reach)


@given(convolutions(), alphas)
def test_at_h_1_it_is_the_leaky_relu_of_the_convolution(case, alpha):
    conv, images = case
    layer = PushPullConv2d.from_conv(conv, scale=1.0, alpha=alpha)
    assert torch.equal(layer(images), F.leaky_relu(conv(images), alpha))


@given(convolutions())
def test_at_h_1_and_alpha_1_it_is_the_convolution_bit_for_bit_and_so_are_its_gradients(case):
    conv, images = case
    twin = PushPullConv2d.from_conv(conv, scale=1.0, alpha=1.0)
    pairs = zip(response_and_gradients(twin, images), response_and_gradients(conv, images), strict=True)
    assert all(torch.equal(of_twin, of_conv) for of_twin, of_conv in pairs)


@given(convolutions(), scales)
def test_without_strength_it_is_the_relu_of_the_convolution(case, scale):
    conv, images = case
    layer = PushPullConv2d.from_conv(conv, scale=scale, alpha=0.0)
    assert torch.equal(layer(images), F.relu(conv(images)))


@given(convolutions(), scales)
def test_the_output_has_the_size_of_the_convolutions(case, scale):
    conv, images = case
    assert PushPullConv2d.from_conv(conv, scale=scale)(images).shape == conv(images).shape


def test_same_padding_of_an_even_kernel_is_refused_because_no_even_border_keeps_the_size():
    with pytest.raises(ValueError, match="same"):
        PushPullConv2d(1, 1, 4, padding="same", scale=1.0)


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_gradients_are_those_of_finite_differences(scale):
    torch.manual_seed(0)  # no response lies so near the kink of a ReLU that a difference would cross it
    shapes = [(2, 4, 6, 7), (4, 2, 3, 3), (4,), (4,)]
    inputs = [torch.randn(shape, dtype=torch.float64, requires_grad=True) for shape in shapes]

    def response(images, weight, bias, alpha):
        return push_pull(
            images, weight, bias, scale=scale, alpha=alpha, stride=(2, 1), padding=(1, 2), dilation=(1, 2), groups=2
        )

    assert torch.autograd.gradcheck(response, inputs)


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_a_negative_trained_strength_acts_as_none(scale):
    layer = PushPullConv2d(3, 4, 3, scale=scale, train_alpha=True)
    nn.init.constant_(layer.alpha, -0.3)
    images = torch.randn(2, 3, 9, 9)
    assert torch.equal(layer(images), F.relu(F.conv2d(images, layer.weight, layer.bias)))


@given(st.integers(1, 8), st.integers(1, 8))
def test_trained_strengths_start_around_one_half_within_the_stated_radius(in_channels, out_channels):
    layer = PushPullConv2d(in_channels, out_channels, 3, train_alpha=True)
    assert layer.alpha.shape == (out_channels,)
    assert (layer.alpha - 0.5).abs().max() <= (in_channels * out_channels) ** -0.5


@pytest.mark.parametrize(("train_alpha", "more"), [(False, 0), (True, 6)])
def test_it_has_the_convolutions_parameters_and_one_more_a_channel_if_trained(train_alpha, more):
    def count(layer):
        return sum(parameter.numel() for parameter in layer.parameters())

    assert count(PushPullConv2d(3, 6, 5, train_alpha=train_alpha)) == count(nn.Conv2d(3, 6, 5)) + more


@pytest.mark.parametrize("train_alpha", [False, True])
def test_a_state_dict_restores_the_layer(train_alpha):
    layer, other = (PushPullConv2d(2, 3, 3, train_alpha=train_alpha) for _ in range(2))
    images = torch.randn(2, 2, 8, 8)
    assert not torch.equal(layer(images), other(images))
    other.load_state_dict(layer.state_dict())
    assert torch.equal(layer(images), other(images))


def test_it_loads_the_weights_of_a_convolution():
    conv, layer = nn.Conv2d(2, 3, 3), PushPullConv2d(2, 3, 3)
    layer.load_state_dict(conv.state_dict())
    assert torch.equal(layer.weight, conv.weight)
    assert torch.equal(layer.bias, conv.bias)


@pytest.mark.parametrize(
    ("kernel_size", "options"),
    [(4, {"scale": 2.0}), ((3, 2), {"scale": 1.5}), (3, {"scale": 0.9}), (3, {"alpha": -0.1})],
)
def test_the_layer_refuses_what_the_equation_does_not_allow(kernel_size, options):
    with pytest.raises(ValueError, match=r"scale must be|alpha must be"):
        PushPullConv2d(1, 1, kernel_size, **options)


@pytest.mark.parametrize(("side", "scale"), [(4, 2.0), (3, 0.9)])
def test_the_function_refuses_what_the_equation_does_not_allow(side, scale):
    with pytest.raises(ValueError, match="push-pull needs"):
        push_pull(torch.zeros(1, 1, 9, 9), torch.zeros(1, 1, side, side), scale=scale)


@pytest.mark.parametrize("train_alpha", [False, True])
@pytest.mark.parametrize("training", [False, True])
@pytest.mark.parametrize("bias", [False, True])
def test_a_layer_made_from_a_convolution_shares_its_parameters_and_mode(train_alpha, training, bias):
    conv = nn.Conv2d(2, 3, 3, bias=bias, dtype=torch.float64).train(training)
    layer = PushPullConv2d.from_conv(conv, train_alpha=train_alpha)
    assert layer.weight is conv.weight
    assert layer.bias is conv.bias
    assert layer.training == training
    assert {(p.device, p.dtype) for p in layer.parameters()} == {(conv.weight.device, torch.float64)}
    assert isinstance(layer.alpha, nn.Parameter) == train_alpha
