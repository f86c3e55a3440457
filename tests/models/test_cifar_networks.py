import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import nn

from sextant.errors import ArgumentError
from sextant.layers import PushPullConv2d, PushPullInhibition
from sextant.models import AlexNetCifar, DenseNetCifar, ResNetCifar, Standardize

SMALL = {
    "resnet": lambda channels, size, classes: ResNetCifar(channels, size, classes, depth=20),
    "densenet": lambda channels, size, classes: DenseNetCifar(channels, size, classes, depth=10, growth=3),
    "alexnet": lambda channels, size, classes: AlexNetCifar(channels, size, classes, hidden=8),
}


@settings(max_examples=12)
@given(
    st.sampled_from(sorted(SMALL)),
    st.sampled_from([1, 2, 3]),
    st.integers(15, 40),
    st.integers(15, 40),
    st.integers(2, 12),
)
def test_every_network_gives_one_logit_a_class_for_images_of_any_size(name, channels, height, width, classes):
    network = SMALL[name](channels, (height, width), classes).eval()
    with torch.no_grad():
        assert network(torch.rand(2, channels, height, width)).shape == (2, classes)


@pytest.mark.parametrize(
    ("depth", "parameters"),
    # He et al. 2016, table 6, print 0.27, 0.46, 0.66, 0.85 million; two 1x1 shortcuts add 16*32 + 32*64 + 2*(32 + 64)
    [(20, 269_722 + 2752), (32, 464_154 + 2752), (44, 658_586 + 2752), (56, 853_018 + 2752)],
)
def test_residual_networks_have_the_known_number_of_parameters(depth, parameters):
    network = ResNetCifar(3, (32, 32), 10, depth=depth)
    assert sum(p.numel() for p in network.parameters()) == parameters
    convolutions = [m for m in network.modules() if isinstance(m, nn.Conv2d) and m.kernel_size == (3, 3)]
    assert len(convolutions) == depth - 1


def densenet_parameters(depth, growth):
    """Counted layer by layer from Huang et al. 2017, without building anything."""
    layers, width, total = (depth - 4) // 6, 24, 3 * 24 * 9
    for block in range(3):
        for _ in range(layers):
            total += 2 * width + width * 4 * growth + 2 * 4 * growth + 4 * growth * growth * 9
            width += growth
        total += 2 * width
        if block < 2:
            total, width = total + width * (width // 2), width // 2
    return total + 10 * width + 10


@pytest.mark.parametrize(
    ("depth", "growth", "printed"), [(40, 12, None), (100, 12, 0.8), (10, 3, None), (16, 24, None)]
)
def test_dense_networks_have_the_parameters_of_their_paper(depth, growth, printed):
    network = DenseNetCifar(3, (32, 32), 10, depth=depth, growth=growth)
    count = sum(p.numel() for p in network.parameters())
    assert count == densenet_parameters(depth, growth)
    if printed is not None:
        assert round(count / 1e6, 1) == printed


def test_alexnet_has_what_is_published_of_it():
    network = AlexNetCifar(3, (32, 32), 10)
    convolutions = [m for m in network.modules() if isinstance(m, nn.Conv2d)]
    assert {conv.kernel_size for conv in convolutions} == {(3, 3)}
    assert [conv.stride for conv in convolutions] == [(2, 2), *[(1, 1)] * 4]
    assert next(m for m in network.modules() if isinstance(m, nn.Linear)).in_features == 1024


def test_a_residual_block_adds_its_input_to_what_it_computes():
    block = ResNetCifar(3, (32, 32), 10).layer1[0].eval()
    nn.init.zeros_(block.bn2.weight)
    x = torch.randn(2, 16, 8, 8)
    torch.testing.assert_close(block(x), x.relu())


def test_a_dense_layer_keeps_its_input_and_appends_to_it():
    layer = DenseNetCifar(3, (32, 32), 10, depth=10, growth=3).features.denseblock1[0].eval()
    x = torch.randn(2, 24, 8, 8)
    y = layer(x)
    assert y.shape == (2, 27, 8, 8)
    assert torch.equal(y[:, :24], x)


def test_the_first_convolution_sees_standardised_images():
    images = torch.tensor([125.3 / 255, 123.0 / 255, 113.9 / 255]).view(1, 3, 1, 1).expand(1, 3, 32, 32)
    seen = []
    network = ResNetCifar(3, (32, 32), 10).eval()
    network.conv1.register_forward_hook(lambda module, inputs, output: seen.append(inputs[0]))
    network(images)
    network(images + torch.tensor([63.0 / 255, 62.1 / 255, 66.7 / 255]).view(1, 3, 1, 1))
    torch.testing.assert_close(seen[0], torch.zeros_like(seen[0]))
    torch.testing.assert_close(seen[1], torch.ones_like(seen[1]))


def test_standardisation_takes_other_constants_and_is_no_part_of_the_weights():
    layer = Standardize(1, [0.2], [0.5])
    torch.testing.assert_close(layer(torch.full((1, 1, 2, 2), 0.7)), torch.ones(1, 1, 2, 2))
    assert not layer.state_dict()


@pytest.mark.parametrize(("mean", "std"), [([0.5], None), (None, [0.1, 0.1, 0.0]), ([0.5] * 4, [0.5] * 4)])
def test_constants_that_do_not_fit_the_channels_are_refused(mean, std):
    with pytest.raises(ValueError, match="3 channels need as many means and positive stds"):
        Standardize(3, mean, std)


def test_convolutions_start_with_hes_variance_on_the_fan_out():
    torch.manual_seed(0)
    for network in (ResNetCifar(3, (32, 32), 10), DenseNetCifar(3, (32, 32), 10)):
        for module in network.modules():
            if isinstance(module, nn.Conv2d) and module.weight.numel() > 4000:
                fan_out = module.out_channels * module.kernel_size[0] * module.kernel_size[1]
                assert module.weight.var().item() == pytest.approx(2 / fan_out, rel=0.15)


def test_the_first_convolution_is_the_one_that_inhibition_replaces():
    for network, path in (
        (ResNetCifar(3, (32, 32), 10), "conv1"),
        (SMALL["densenet"](3, (32, 32), 10), "features.conv0"),
    ):
        assert isinstance(PushPullInhibition()(network).get_submodule(path), PushPullConv2d)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ResNetCifar(3, (32, 32), 10, depth=18), r"depth=18 must be 6 n \+ 2"),
        (lambda: ResNetCifar(3, (3, 32), 10), "at least 4x4 pixels, got 3x32"),
        (
            lambda: DenseNetCifar(3, (32, 32), 10, depth=41),
            r"depth=41 must be 6 n \+ 4",
        ),
        (lambda: DenseNetCifar(3, (32, 32), 10, growth=0), "growth=0 must be at least 1"),
        (lambda: DenseNetCifar(3, (32, 3), 10), "at least 4x4 pixels, got 32x3"),
        (lambda: AlexNetCifar(3, (14, 32), 10), "at least 15x15 pixels, got 14x32"),
    ],
)
def test_networks_that_cannot_be_are_refused(make, message):
    with pytest.raises((ValueError, ArgumentError), match=message):
        make()
