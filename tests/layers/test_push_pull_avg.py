"""The layer of 2024 against its equation in numpy, and its two forms against each other."""

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from hypothesis import given
from hypothesis import strategies as st
from layers.convolution_cases import NUMPY_BORDER, convolutions
from torch import nn

from sextant.layers import PushPullAvgConv2d, push_pull_avg

averages = st.sampled_from([1, 3, 5])


def mean_nearby(planes, side):
    """The mean of the values within a square around each place, place by place."""
    reach, (height, width) = side // 2, planes.shape[-2:]
    result = np.empty_like(planes)
    for y in range(height):
        for x in range(width):
            nearby = planes[..., max(0, y - reach) : y + reach + 1, max(0, x - reach) : x + reach + 1]
            result[..., y, x] = nearby.mean((-2, -1))
    return result


def by_the_equation(conv, images, average, strengths):
    weight = conv.weight.detach().numpy()
    border = {"valid": (0, 0), "same": [d * (k // 2) for d, k in zip(conv.dilation, conv.kernel_size, strict=True)]}
    padding = conv.padding if isinstance(conv.padding, tuple) else border[conv.padding]
    padded = np.pad(images.numpy(), [(0, 0), (0, 0), *[(p, p) for p in padding]], mode=NUMPY_BORDER[conv.padding_mode])

    def convolve(kernels):
        kernels = torch.from_numpy(kernels)
        return F.conv2d(torch.from_numpy(padded), kernels, None, conv.stride, 0, conv.dilation, conv.groups).numpy()

    inverted = np.stack([-kernel + kernel.max() + kernel.min() for kernel in weight])
    pull = np.maximum(mean_nearby(convolve(inverted), average), 0)
    response = np.maximum(convolve(weight), 0) - np.reshape(strengths, (-1, 1, 1)) * pull
    return response if conv.bias is None else response + conv.bias.detach().numpy()[:, None, None]


@given(convolutions(), averages, st.floats(0, 3), st.sampled_from(["box", "direct"]))
def test_the_response_is_the_equation(case, average, alpha, impl):
    conv, images = case
    strengths = np.linspace(0.5, 1.5, conv.out_channels) * alpha
    layer = PushPullAvgConv2d.from_conv(conv, average=average, alpha=strengths.tolist(), impl=impl)
    expected = torch.from_numpy(by_the_equation(conv, images, average, strengths))
    torch.testing.assert_close(layer(images), expected, rtol=0, atol=1e-11)


@given(convolutions(), averages)
def test_the_box_form_and_two_convolutions_differ_by_rounding_alone(case, average):
    conv, images = case
    for dtype, most in ((torch.float64, 1e-12), (torch.float32, 1e-5)):
        direct, box = (
            PushPullAvgConv2d.from_conv(conv.to(dtype), average=average, impl=impl)(images.to(dtype))
            for impl in ("direct", "box")
        )
        assert (box - direct).abs().max() <= most * max(1.0, direct.abs().max())


@pytest.mark.parametrize("padding_mode", list(NUMPY_BORDER))
def test_the_forms_agree_for_even_kernels_and_uneven_borders(padding_mode):
    conv = nn.Conv2d(4, 6, (4, 2), padding="same", groups=2, padding_mode=padding_mode, dtype=torch.float64)
    images = torch.randn(2, 4, 11, 12, dtype=torch.float64)
    box, direct = (PushPullAvgConv2d.from_conv(conv, impl=impl)(images) for impl in ("box", "direct"))
    assert box.shape == conv(images).shape
    torch.testing.assert_close(box, direct, rtol=0, atol=1e-12)


@given(convolutions(), averages)
def test_without_strength_it_is_the_relu_of_the_convolution_plus_the_bias(case, average):
    conv, images = case
    layer = PushPullAvgConv2d.from_conv(conv, average=average, alpha=0.0)
    bias = torch.zeros(conv.out_channels, dtype=torch.float64) if conv.bias is None else conv.bias
    expected = F.relu(conv(images) - bias.view(-1, 1, 1)) + bias.view(-1, 1, 1)
    torch.testing.assert_close(layer(images), expected, rtol=0, atol=1e-12)


@given(convolutions(), averages)
def test_the_output_has_the_size_of_the_convolutions(case, average):
    conv, images = case
    assert PushPullAvgConv2d.from_conv(conv, average=average)(images).shape == conv(images).shape


@pytest.mark.parametrize("average", [1, 3])
@pytest.mark.parametrize("impl", ["box", "direct"])
def test_gradients_are_those_of_finite_differences(impl, average):
    torch.manual_seed(0)
    shapes = [(2, 4, 6, 7), (4, 2, 3, 3), (4,), (4,)]
    inputs = [torch.randn(shape, dtype=torch.float64, requires_grad=True) for shape in shapes]

    def response(images, weight, bias, alpha):
        return push_pull_avg(
            images,
            weight,
            bias,
            average=average,
            alpha=alpha,
            stride=(2, 1),
            padding=(1, 2),
            dilation=(1, 2),
            groups=2,
            impl=impl,
        )

    assert torch.autograd.gradcheck(response, inputs)


@pytest.mark.parametrize("impl", ["box", "direct"])
def test_one_image_without_a_batch_is_as_in_a_batch(impl):
    layer = PushPullAvgConv2d(4, 6, 3, padding=1, groups=2, impl=impl)
    images = torch.randn(1, 4, 9, 9)
    torch.testing.assert_close(layer(images[0]), layer(images)[0])


def test_trained_strengths_start_between_zero_and_one_and_never_excite():
    layer = PushPullAvgConv2d(3, 64, 3, train_alpha=True)
    assert layer.alpha.shape == (64,)
    assert (layer.alpha >= 0).all()
    assert (layer.alpha <= 1).all()
    assert layer.alpha.max() > 0.8
    layer.set_strength(1.0)
    nn.init.constant_(layer.alpha, -0.3)
    images = torch.randn(1, 3, 9, 9)
    expected = F.relu(F.conv2d(images, layer.weight)) + layer.bias.view(-1, 1, 1)
    torch.testing.assert_close(layer(images), expected)


def test_it_shares_the_parameters_of_the_convolution_it_is_made_from_and_has_its_state():
    conv = nn.Conv2d(2, 3, 3).eval()
    layer = PushPullAvgConv2d.from_conv(conv)
    assert layer.weight is conv.weight
    assert layer.bias is conv.bias
    assert layer.state_dict().keys() == conv.state_dict().keys()
    assert not layer.training


@pytest.mark.parametrize("options", [{"average": 2}, {"average": 0}, {"average": 2.5}, {"alpha": -1.0}])
def test_what_the_equation_does_not_allow_is_refused(options):
    with pytest.raises(ValueError, match="must be"):
        PushPullAvgConv2d(1, 1, 3, **options)
    if "average" in options:
        with pytest.raises(ValueError, match="must be"):
            push_pull_avg(torch.zeros(1, 1, 9, 9), torch.zeros(1, 1, 3, 3), **options)


def test_an_unknown_implementation_is_refused():
    with pytest.raises(ValueError, match="box or direct"):
        push_pull_avg(torch.zeros(1, 1, 9, 9), torch.zeros(1, 1, 3, 3), impl="rows")
    with pytest.raises(ValueError, match="impl must be"):
        PushPullAvgConv2d(1, 1, 3, impl="rows")
