import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import convolve1d
from torch import nn

from sextant.errors import ArgumentError, UserError
from sextant.layers import (
    AntiAliasing,
    BlurPool2d,
    PushPullConv2d,
    anti_alias,
    anti_aliased_conv,
    anti_aliased_pool,
    blur_pool,
)
from sextant.layers.blur_pool import binomial_taps
from sextant.models import AlexNetCifar

SCIPY_BORDER = {"zeros": "constant", "reflect": "mirror", "replicate": "nearest", "circular": "wrap"}
sizes = st.tuples(st.integers(6, 12), st.integers(6, 12))
strides = st.tuples(st.integers(1, 3), st.integers(1, 3))


@pytest.mark.parametrize(
    ("taps", "expected"), [(1, [1]), (2, [1, 1]), (3, [1, 2, 1]), (4, [1, 3, 3, 1]), (5, [1, 4, 6, 4, 1])]
)
def test_the_filter_is_binomial(taps, expected):
    assert (binomial_taps(taps) * 2 ** (taps - 1)).tolist() == expected


@given(st.integers(0, 99), st.sampled_from([1, 3, 5]), strides, sizes, st.sampled_from(list(SCIPY_BORDER)))
def test_it_filters_as_scipy_does_and_keeps_every_stride_th_pixel(seed, taps, stride, size, padding_mode):
    images = np.random.default_rng(seed).normal(size=(2, 3, *size))
    profile, expected = binomial_taps(taps, dtype=torch.float64).numpy(), images
    for axis in (-2, -1):
        expected = convolve1d(expected, profile, axis, mode=SCIPY_BORDER[padding_mode])
    expected = expected[..., :: stride[0], :: stride[1]]
    result = blur_pool(torch.from_numpy(images), taps, stride, padding_mode)
    np.testing.assert_allclose(result, expected, atol=1e-12)


@given(st.integers(1, 7), strides, sizes, st.sampled_from(list(SCIPY_BORDER)))
def test_its_size_is_the_strides_share_rounded_up(taps, stride, size, padding_mode):
    result = BlurPool2d(taps, stride, padding_mode)(torch.zeros(1, 2, *size))
    assert result.shape[-2:] == tuple(-(-side // step) for side, step in zip(size, stride, strict=True))


@given(st.integers(1, 7), sizes, st.sampled_from(["reflect", "replicate", "circular"]))
def test_a_constant_image_stays(taps, size, padding_mode):
    assert torch.equal(blur_pool(torch.ones(2, *size), taps, 1, padding_mode), torch.ones(2, *size))


@pytest.mark.parametrize(("taps", "size"), [(3, (1, 1)), (3, (1, 6)), (5, (2, 2)), (7, (3, 8))])
def test_images_too_small_to_be_mirrored_repeat_their_edges(taps, size):
    images = torch.randn(2, 3, *size)
    assert torch.equal(blur_pool(images, taps), blur_pool(images, taps, padding_mode="replicate"))
    assert torch.equal(torch.jit.script(BlurPool2d(taps))(images), blur_pool(images, taps))
    assert torch.equal(torch.fx.symbolic_trace(BlurPool2d(taps))(images), blur_pool(images, taps))


def test_a_small_network_is_anti_aliased_down_to_maps_of_one_pixel():
    network = AntiAliasing()(AlexNetCifar(3, (16, 16), 10)).eval()
    assert network(torch.rand(2, 3, 16, 16)).isfinite().all()


def test_the_finest_pattern_is_gone_where_plain_subsampling_would_alias_it():
    stripes = torch.tensor([1.0, -1.0]).repeat(8).expand(1, 1, 16, 16)
    assert torch.equal(stripes[..., ::2, ::2], torch.ones(1, 1, 8, 8))
    assert torch.equal(blur_pool(stripes), torch.zeros(1, 1, 8, 8))


def test_gradients_are_those_of_finite_differences():
    images = torch.randn(2, 2, 6, 7, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda x: blur_pool(x, 4, (2, 3)), images)


@pytest.mark.parametrize("options", [{"taps": 0}, {"stride": 0}, {"stride": (1, 0)}])
def test_what_cannot_be_is_refused(options):
    with pytest.raises(ArgumentError, match=r"taps=.* must be at least 1"):
        BlurPool2d(**options)
    with pytest.raises(ArgumentError, match=r"taps=.* must be at least 1"):
        blur_pool(torch.zeros(1, 1, 8, 8), **options)


@pytest.mark.parametrize("dtype", [torch.uint8, torch.int64, torch.bool])
def test_whole_numbers_are_refused_as_the_filter_would_round_to_zero(dtype):
    with pytest.raises(ArgumentError, match=f"need floating-point images, got {dtype}"):
        blur_pool(torch.ones(1, 1, 4, 4, dtype=dtype))


@given(
    st.integers(2, 3), st.integers(1, 3), st.integers(0, 1), st.integers(1, 2), st.integers(8, 14), st.integers(1, 5)
)
def test_an_anti_aliased_pool_has_the_size_of_the_pool(kernel, stride, padding, dilation, side, taps):
    pool = nn.MaxPool2d(kernel, stride, padding, dilation)
    images = torch.zeros(1, 2, side, side)
    blurred = anti_aliased_pool(pool, taps)
    assert blurred(images).shape == pool(images).shape
    assert blurred[0].stride == 1


@given(st.sampled_from([1, 2, 3, 5]), st.integers(1, 3), st.integers(0, 2), st.integers(1, 2), st.integers(11, 14))
def test_an_anti_aliased_convolution_has_the_size_and_weights_of_the_convolution(
    kernel, stride, padding, dilation, side
):
    conv = nn.Conv2d(2, 3, kernel, stride, padding, dilation)
    images = torch.zeros(1, 2, side, side)
    size, weights = conv(images).shape, conv.weight
    blurred = anti_aliased_conv(conv)
    assert blurred(images).shape == size
    assert any(module.weight is weights for module in blurred if isinstance(module, nn.Conv2d))


def test_a_1x1_convolution_is_blurred_before_to_the_same_result():
    conv = nn.Conv2d(4, 3, 1, 2, dtype=torch.float64)
    images = torch.randn(1, 4, 9, 9, dtype=torch.float64)
    blurred = anti_aliased_conv(conv)
    assert isinstance(blurred[0], BlurPool2d)
    torch.testing.assert_close(blurred(images), blur_pool(conv(images)))


def test_a_push_pull_layer_can_be_anti_aliased():
    layer = PushPullConv2d(2, 3, 3, 2, 1)
    images = torch.randn(1, 2, 9, 9)
    dense = PushPullConv2d(2, 3, 3, 1, 1)
    dense.load_state_dict(layer.state_dict())
    assert torch.equal(anti_aliased_conv(layer)(images), blur_pool(dense(images)))


@pytest.mark.parametrize("pool", [nn.MaxPool2d(2, ceil_mode=True), nn.MaxPool2d(2, return_indices=True)])
def test_a_pool_that_has_no_anti_aliased_form_is_refused(pool):
    with pytest.raises(ValueError, match="no anti-aliased form"):
        anti_aliased_pool(pool)


def test_a_resnet_is_anti_aliased_wherever_it_subsamples():
    from torchvision.models import resnet18

    network = resnet18(weights=None).eval()
    images = torch.randn(1, 3, 64, 64)
    shape = network(images).shape
    conversion = anti_alias(network)
    assert set(conversion.changed) == {
        "conv1",
        "maxpool",
        *(f"layer{stage}.0.{name}" for stage in (2, 3, 4) for name in ("conv1", "downsample.0")),
    }
    assert network(images).shape == shape
    blurs = [module for module in network.modules() if isinstance(module, BlurPool2d)]
    assert len(blurs) == 8
    assert all(
        getattr(m, "stride", 1) in (1, (1, 1)) for m in network.modules() if isinstance(m, nn.Conv2d | nn.MaxPool2d)
    )


def test_a_network_that_never_subsamples_is_refused():
    with pytest.raises(UserError, match="matches no Conv2d"):
        anti_alias(nn.Sequential(nn.Conv2d(1, 2, 3), nn.MaxPool2d(3, 1)))


def test_an_experiment_can_choose_it():
    network = AntiAliasing(taps=5)(nn.Sequential(nn.Conv2d(1, 4, 3), nn.MaxPool2d(2)))
    assert isinstance(network[1][1], BlurPool2d)
    assert network[1][1].taps == 5
    assert network(torch.zeros(1, 1, 16, 16)).shape == (1, 4, 7, 7)


@pytest.mark.parametrize("padding_mode", list(SCIPY_BORDER))
@pytest.mark.filterwarnings("ignore:.*torch.jit:FutureWarning")
def test_it_can_be_scripted_and_traced(padding_mode):
    layer = BlurPool2d(4, (2, 3), padding_mode)
    scripted = torch.jit.script(layer)
    for images in (torch.randn(2, 3, 9, 11), torch.randn(5, 8, 12)):
        assert torch.equal(scripted(images), layer(images))
        assert torch.equal(torch.fx.symbolic_trace(layer)(images), layer(images))


@pytest.mark.slow
@pytest.mark.parametrize("dynamo", [False, True])
@pytest.mark.filterwarnings("ignore::torch.jit.TracerWarning", "ignore::FutureWarning", "ignore::DeprecationWarning")
def test_both_onnx_exporters_take_it(dynamo, tmp_path):
    for needed in ("onnx", "onnxscript"):
        pytest.importorskip(needed)
    runtime = pytest.importorskip("onnxruntime")
    network = AntiAliasing()(nn.Sequential(nn.Conv2d(3, 4, 3, 2, 1), nn.ReLU(), nn.MaxPool2d(2))).eval()
    images = torch.randn(2, 3, 20, 24)
    torch.onnx.export(network, (images,), tmp_path / "network.onnx", dynamo=dynamo, verbose=False)
    session = runtime.InferenceSession(tmp_path / "network.onnx", providers=["CPUExecutionProvider"])
    (outputs,) = session.run(None, {session.get_inputs()[0].name: images.numpy()})
    torch.testing.assert_close(torch.from_numpy(outputs), network(images), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float64])
def test_it_works_in_every_precision(dtype):
    images = torch.randn(1, 2, 8, 8, dtype=dtype)
    assert BlurPool2d()(images).dtype == dtype
    assert BlurPool2d().to(dtype)(images).dtype == dtype
