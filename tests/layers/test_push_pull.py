"""Push-pull against its equation written out anew in numpy, and against the convolution that it becomes at h = 1."""

from functools import partial
from itertools import pairwise

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from hypothesis import given
from hypothesis import strategies as st
from layers.convolution_cases import NUMPY_BORDER, convolutions
from torch import nn

from sextant.layers import (
    PushPullAvgConv2d,
    PushPullConv2d,
    pull_kernel_size,
    push_pull,
    push_pull_avg,
    strength_path,
    upsample_kernel,
)

scales = st.floats(1.0, 2.5)
alphas = st.floats(0.0, 3.0)
IMPLEMENTATIONS = ["direct", "rows", "factorised"]


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


@given(convolutions(), st.floats(1.7, 2.5), alphas, st.sampled_from(IMPLEMENTATIONS))
def test_the_response_is_the_papers_equation(case, scale, alpha, impl):
    conv, images = case
    strengths = torch.linspace(0.5, 1.5, conv.out_channels, dtype=torch.float64) * alpha
    layer = PushPullConv2d.from_conv(conv, scale=scale, train_alpha=True, impl=impl)
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


@pytest.mark.parametrize("padding_mode", list(NUMPY_BORDER))
@pytest.mark.parametrize(("kernel", "dilation"), [(4, 1), ((2, 4), (1, 3)), ((4, 3), 1)])
def test_same_padding_of_an_even_kernel_puts_the_odd_pixel_where_the_convolution_does(kernel, dilation, padding_mode):
    conv = nn.Conv2d(2, 3, kernel, padding="same", dilation=dilation, padding_mode=padding_mode)
    images = torch.randn(2, 2, 11, 12)
    assert torch.equal(PushPullConv2d.from_conv(conv, scale=1.0)(images), conv(images))


@given(convolutions(), st.floats(1.0, 2.5), st.sampled_from(["rows", "factorised"]))
def test_factorised_and_direct_pulls_differ_by_rounding_alone(case, scale, impl):
    conv, images = case
    for dtype, most in ((torch.float64, 1e-12), (torch.float32, 1e-5)):
        direct, other = (
            PushPullConv2d.from_conv(conv.to(dtype), scale=scale, impl=choice)(images.to(dtype))
            for choice in ("direct", impl)
        )
        assert other.shape == direct.shape
        assert (other - direct).abs().max() <= most * max(1.0, direct.abs().max())


@pytest.mark.parametrize("impl", ["rows", "factorised"])
def test_factorised_pulls_have_the_gradients_of_the_direct_one(impl):
    torch.manual_seed(0)
    conv = nn.Conv2d(4, 6, (3, 5), (2, 1), (1, 3), groups=2, padding_mode="reflect", dtype=torch.float64)
    images = torch.randn(2, 4, 12, 9, dtype=torch.float64)
    gradients = [
        response_and_gradients(PushPullConv2d.from_conv(conv, impl=choice), images) for choice in ("direct", impl)
    ]
    for direct, other in zip(*gradients, strict=True):
        torch.testing.assert_close(other, direct, rtol=0, atol=1e-11)


def test_the_implementation_taken_is_the_one_the_layer_tells():
    layer = PushPullConv2d(3, 16, 3, padding=1)
    images = torch.randn(2, 3, 32, 32)
    automatic = layer(images)
    layer.impl = layer.implementation(32, 32)
    assert torch.equal(layer(images), automatic)


@pytest.mark.parametrize("impl", IMPLEMENTATIONS)
@pytest.mark.parametrize("alpha", [0.0, 0.7, [0.1, 0.2, 0.3]])
def test_responses_without_gradients_are_the_same_to_the_last_bit(impl, alpha):
    layer = PushPullConv2d(2, 3, 3, padding=1, alpha=alpha, impl=impl)
    images = torch.randn(2, 2, 9, 9)
    kept = images.clone()
    with torch.no_grad():
        without = layer(images)
    assert torch.equal(without, layer(images))
    assert torch.equal(images, kept)


def test_an_unknown_implementation_is_refused():
    for scale in (1.0, 2.0):
        with pytest.raises(ValueError, match="impl must be one of auto, direct, rows, factorised"):
            push_pull(torch.zeros(1, 1, 9, 9), torch.zeros(1, 1, 3, 3), scale=scale, impl="quick")
    with pytest.raises(ValueError, match="impl must be"):
        PushPullConv2d(1, 1, 3, impl="quick")


@pytest.mark.parametrize("impl", IMPLEMENTATIONS)
@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_one_image_without_a_batch_is_as_in_a_batch(scale, impl):
    layer = PushPullConv2d(2, 3, 3, padding=1, padding_mode="reflect", scale=scale, impl=impl)
    images = torch.randn(1, 2, 9, 9)
    torch.testing.assert_close(layer(images[0]), layer(images)[0])


def test_strengths_can_be_fixed_one_a_channel():
    conv = nn.Conv2d(2, 3, 3, dtype=torch.float64)
    layer = PushPullConv2d.from_conv(conv, alpha=[0.0, 0.5, 2.0])
    images = torch.randn(2, 2, 9, 9, dtype=torch.float64)
    for channel, alpha in enumerate([0.0, 0.5, 2.0]):
        alone = PushPullConv2d.from_conv(conv, alpha=alpha)(images)
        torch.testing.assert_close(layer(images)[:, channel], alone[:, channel])


@pytest.mark.parametrize("before", [1.0, [1.0, 2.0, 3.0]])
@pytest.mark.parametrize("after", [0.5, [0.5, 0.0, 1.5]])
def test_setting_the_strength_of_a_layer_is_making_it_with_that_strength(before, after):
    layer = PushPullConv2d(2, 3, 3, alpha=before, scale=1.0)
    layer.set_strength(after, scale=2.0)
    made = PushPullConv2d.from_conv(layer, alpha=after, scale=2.0)
    images = torch.randn(2, 2, 9, 9)
    assert torch.equal(layer(images), made(images))


def test_a_trained_strength_is_set_in_place_and_stays_trained():
    layer = PushPullConv2d(2, 3, 3, scale=1.0, train_alpha=True)
    parameter = layer.alpha
    layer.set_strength(1.0)
    assert layer.alpha is parameter
    images = torch.randn(2, 2, 9, 9)
    assert torch.equal(layer(images), F.conv2d(images, layer.weight, layer.bias))


@pytest.mark.parametrize("options", [{"alpha": -1.0}, {"alpha": [1.0, 2.0]}, {"scale": 0.5}, {"alpha": float("nan")}])
def test_a_strength_that_cannot_be_is_refused(options):
    with pytest.raises(ValueError, match="must be"):
        PushPullConv2d(2, 3, 3).set_strength(**options)


@pytest.mark.parametrize(("alpha", "scale"), [(0.0, 2.0), (0.5, 1.5), (1.0, 2.0), (3.0, 3.0)])
def test_the_path_to_inhibition_starts_at_the_convolution_and_has_no_jump(alpha, scale):
    torch.manual_seed(0)
    layer, images = PushPullConv2d(2, 3, 3, padding=1), torch.randn(2, 2, 9, 9)

    def response(progress):
        layer.set_strength(*strength_path(progress, alpha=alpha, scale=scale))
        return layer(images)

    conv = F.conv2d(images, layer.weight, layer.bias, padding=1)
    assert torch.equal(response(0.0), conv)
    assert torch.equal(response(1.0), PushPullConv2d.from_conv(layer, alpha=alpha, scale=scale)(images))
    steps = [response(progress) for progress in torch.linspace(0, 1, 21).tolist()]
    pull = F.relu(conv) - PushPullConv2d.from_conv(layer, alpha=1.0, scale=scale)(images)
    fastest = 0.1 * max(conv.abs().max(), alpha * pull.max())
    assert all((after - before).abs().max() <= 1.001 * fastest for before, after in pairwise(steps))


@pytest.mark.parametrize("impl", IMPLEMENTATIONS)
@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_gradients_are_those_of_finite_differences(scale, impl):
    torch.manual_seed(0)  # no response lies so near the kink of a ReLU that a difference would cross it
    shapes = [(2, 4, 6, 7), (4, 2, 3, 3), (4,), (4,)]
    inputs = [torch.randn(shape, dtype=torch.float64, requires_grad=True) for shape in shapes]

    def response(images, weight, bias, alpha):
        return push_pull(
            images,
            weight,
            bias,
            scale=scale,
            alpha=alpha,
            stride=(2, 1),
            padding=(1, 2),
            dilation=(1, 2),
            groups=2,
            impl=impl,
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


def test_strengths_fixed_one_a_channel_are_in_the_state_dict():
    layer, other = (PushPullConv2d(2, 3, 3, alpha=alpha) for alpha in ([0.0, 0.5, 2.0], [1.0, 1.0, 1.0]))
    other.load_state_dict(layer.state_dict())
    assert other.alpha.tolist() == [0.0, 0.5, 2.0]
    assert PushPullConv2d(2, 3, 3, alpha=0.5).state_dict().keys() == nn.Conv2d(2, 3, 3).state_dict().keys()


@pytest.mark.parametrize("prefix", ["", "0."])
def test_a_state_dict_without_fixed_strengths_leaves_them_as_they_are(prefix):
    layer = PushPullConv2d(2, 3, 3, alpha=[0.0, 0.5, 2.0])
    network = nn.Sequential(layer) if prefix else layer
    before = {f"{prefix}{name}": tensor for name, tensor in nn.Conv2d(2, 3, 3).state_dict().items()}
    network.load_state_dict(before)  # strict
    assert layer.alpha.tolist() == [0.0, 0.5, 2.0]
    assert torch.equal(layer.weight, before[f"{prefix}weight"])
    assert before.keys() == {f"{prefix}weight", f"{prefix}bias"}


def test_trained_strengths_that_act_as_zero_are_not_loaded_as_fixed_ones():
    trained, fixed = PushPullConv2d(2, 3, 3, train_alpha=True), PushPullConv2d(2, 3, 3, alpha=[1.0, 1.0, 1.0])
    with torch.no_grad():
        trained.alpha[1] = -0.2
    with pytest.raises(RuntimeError, match=r"alpha: alpha must be >= 0"):
        fixed.load_state_dict(trained.state_dict())


@pytest.mark.parametrize(
    ("kernel_size", "options"),
    [
        (4, {"scale": 2.0}),
        ((3, 2), {"scale": 1.5}),
        (3, {"scale": 0.9}),
        (3, {"scale": float("nan")}),
        (3, {"scale": float("inf")}),
        (3, {"alpha": -0.1}),
    ],
)
def test_the_layer_refuses_what_the_equation_does_not_allow(kernel_size, options):
    with pytest.raises(ValueError, match=r"scale must be|alpha must be"):
        PushPullConv2d(1, 1, kernel_size, **options)


@pytest.mark.parametrize(("side", "scale"), [(4, 2.0), (3, 0.9), (3, float("nan")), (3, float("inf"))])
def test_the_function_refuses_what_the_equation_does_not_allow(side, scale):
    with pytest.raises(ValueError, match="push-pull needs"):
        push_pull(torch.zeros(1, 1, 9, 9), torch.zeros(1, 1, side, side), scale=scale)


@pytest.mark.parametrize("scale", [1.0, 2.0])
@pytest.mark.parametrize("function", [push_pull, partial(push_pull_avg, average=1), push_pull_avg])
@pytest.mark.parametrize("alpha", [-1.0, float("nan"), float("inf"), True, [0.5], torch.rand(4), torch.rand(1, 1)])
def test_the_functions_refuse_strengths_that_are_not_one_number_or_one_a_channel(function, alpha, scale):
    options = {"scale": scale} if function is push_pull else {}
    with pytest.raises(ValueError, match="one number or one for each of 1 channels"):
        function(torch.zeros(1, 1, 9, 9), torch.zeros(1, 1, 3, 3), alpha=alpha, **options)


@pytest.mark.parametrize("make", [PushPullConv2d, PushPullAvgConv2d])
@pytest.mark.parametrize("alpha", [np.array([3.0, 0.5, 1.0])[::-1], np.array(0.5), np.float32(0.5)])
def test_strengths_may_be_numpys(make, alpha):
    layer = make(2, 3, 3, alpha=alpha)
    other = make.from_conv(layer, alpha=alpha.tolist())
    images = torch.randn(2, 2, 9, 9)
    assert torch.equal(layer(images), other(images))
    other.set_strength(alpha)
    assert torch.equal(layer(images), other(images))


@pytest.mark.parametrize("make", [PushPullConv2d, PushPullAvgConv2d])
@pytest.mark.parametrize("alpha", [True, [True, False, True], torch.tensor(True), "1", ["1"] * 3, np.ones((3, 1))])
def test_strengths_that_are_no_numbers_are_refused(make, alpha):
    with pytest.raises(ValueError, match="alpha must be >= 0 and finite"):
        make(2, 3, 3, alpha=alpha)


@pytest.mark.parametrize(
    ("make", "options"),
    [
        (PushPullConv2d, {"scale": 1.0}),
        *[(PushPullConv2d, {"impl": impl}) for impl in IMPLEMENTATIONS],
        *[(PushPullAvgConv2d, {"average": average, "impl": impl}) for average in (1, 3) for impl in ("box", "direct")],
    ],
)
@pytest.mark.parametrize("alpha", [0.5, [0.1, 0.5, 2.0], "trained"])
def test_under_autocast_responses_are_of_the_type_of_the_convolutions(make, options, alpha):
    strength = {"train_alpha": True} if alpha == "trained" else {"alpha": alpha}
    layer, images = make(2, 3, 3, padding=1, **strength, **options), torch.randn(2, 2, 9, 9)
    with torch.autocast("cpu", torch.bfloat16):
        kept = layer(images)
        with torch.no_grad():
            assert torch.equal(layer(images), kept)
    assert kept.dtype == torch.bfloat16
    assert layer(images).dtype == torch.float32


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
