import copy

import pytest
import torch
import torch.nn.functional as F
from hypothesis import given
from hypothesis import strategies as st
from torch import nn

from sextant.layers import PushPullAvgConv2d, PushPullConv2d, PushPullInhibition, pull_kernel_size
from sextant.models import DenseNetCifar, LeNet, ResNetCifar, network_cost
from sextant.models.cost import interpolation_entries, pull_macs_per_pixel

# MACs in millions; what the pull adds in per cent, direct and factorised
PUBLISHED = [
    (lambda: ResNetCifar(3, (32, 32), 10, depth=20), 40.81, 5.9, 1.4),
    (lambda: ResNetCifar(3, (32, 32), 10, depth=32), 69.1, 3.5, 0.8),
    (lambda: ResNetCifar(3, (32, 32), 10, depth=44), 97.4, 2.5, 0.6),
    (lambda: ResNetCifar(3, (32, 32), 10, depth=56), 125.75, 1.9, 0.5),
    (lambda: DenseNetCifar(3, (32, 32), 10, depth=40, growth=12), 72.4, 5.0, None),
    (lambda: DenseNetCifar(3, (32, 32), 10, depth=100, growth=12), 287.9, 1.3, None),
]


def per_cent_of_the_pull(cost):
    return 100 * cost.pull_macs / (cost.macs - cost.pull_macs)


@pytest.mark.parametrize(("make", "millions", "direct", "factorised"), PUBLISHED)
def test_networks_cost_what_was_counted_by_hand(make, millions, direct, factorised):
    plain = network_cost(network := make(), (32, 32), 3)
    assert plain.macs / 1e6 == pytest.approx(millions, abs=0.05)
    assert (plain.pull_macs, plain.uncounted) == (0, ())
    inhibited = PushPullInhibition(scale=2.0, alpha=1.0)(network)
    cost = network_cost(inhibited, (32, 32), 3)
    assert cost.parameters == plain.parameters
    assert per_cent_of_the_pull(cost) == pytest.approx(direct, abs=0.05)
    if factorised is not None:
        cost = network_cost(inhibited, (32, 32), 3, pull="factorised")
        assert per_cent_of_the_pull(cost) == pytest.approx(factorised, abs=0.05)


@pytest.mark.parametrize("depth", [20, 56])
def test_residual_networks_cost_exactly_what_their_table_of_layers_says(depth):
    blocks, block = (depth - 2) // 6, 16 * 16 * 9 * 32 * 32  # a 3x3 convolution costs the same in every stage
    stem, halving, shortcut = 3 * 16 * 9 * 32 * 32, 16 * 32 * 9 * 16 * 16, 16 * 32 * 16 * 16
    macs = stem + (3 * 2 * blocks - 2) * block + 2 * (halving + shortcut) + 64 * 10
    assert network_cost(ResNetCifar(3, (32, 32), 10, depth=depth), (32, 32), 3).macs == macs


@pytest.mark.parametrize(("variant", "share"), [("A", 136), ("B", 225), ("C", 127), ("D", 219)])
def test_inhibition_more_than_doubles_the_cost_of_lenet(variant, share):
    network = PushPullInhibition()(LeNet(variant, 1, (28, 28), 10))
    assert per_cent_of_the_pull(network_cost(network, (28, 28), 1)) == pytest.approx(share, abs=0.5)


@pytest.mark.parametrize(
    ("channels", "outputs", "kernel", "scale", "direct", "factorised"),
    [(3, 16, 3, 2, 2352, 564), (1, 6, 5, 2, 726, 264), (3, 16, 3, 1.5, 1200, 516), (3, 64, 7, 2, 43200, 10056)],
)
def test_a_pull_costs_what_its_formula_gave_by_hand(channels, outputs, kernel, scale, direct, factorised):
    layer = PushPullConv2d(channels, outputs, kernel, scale=scale)
    assert pull_macs_per_pixel(layer) == direct
    assert pull_macs_per_pixel(layer, "factorised") == factorised


def test_a_window_sum_costs_the_channels_of_the_output_less_than_a_second_convolution():
    layer = PushPullAvgConv2d(3, 64, 7, stride=2, padding=3)
    second, window = (network_cost(nn.Sequential(layer), (224, 224), 3, pull=pull) for pull in ("direct", "factorised"))
    assert second.pull_macs == 64 * window.pull_macs == 9408 * 112 * 112
    resnet_50 = 4089.18e6
    assert second.pull_macs / resnet_50 == pytest.approx(0.0289, abs=5e-5)
    assert window.pull_macs / resnet_50 == pytest.approx(0.0005, abs=5e-5)


@given(st.sampled_from([1, 3, 5, 7, 9, 11]), st.floats(1.1, 4))
def test_interpolation_has_as_many_entries_as_its_matrix(size, scale):
    stretched = pull_kernel_size(size, scale)
    matrix = F.interpolate(
        torch.eye(size, dtype=torch.float64)[None], size=stretched, mode="linear", align_corners=True
    )
    assert interpolation_entries(size, stretched) == int((matrix.abs() > 1e-9).sum())


@given(
    st.integers(1, 3),
    st.integers(1, 3),
    st.integers(1, 2),
    st.sampled_from([1, 3, 5]),
    st.integers(1, 3),
    st.integers(1, 2),
)
def test_a_convolution_costs_one_product_a_weight_and_output_pixel(inputs, outputs, groups, kernel, stride, dilation):
    conv = nn.Conv2d(inputs * groups, outputs * groups, kernel, stride, 3, dilation, groups)
    height, width = 13, 16
    out = conv(torch.zeros(1, inputs * groups, height, width))
    products = out.numel() * inputs * kernel * kernel
    assert network_cost(nn.Sequential(conv), (height, width), inputs * groups).macs == products


def test_the_twin_costs_nothing_more():
    network = PushPullInhibition(scale=1.0)(LeNet("A", 1, (28, 28), 10))
    assert network_cost(network, (28, 28), 1).pull_macs == 0


def test_counting_leaves_the_network_as_it_was():
    network = ResNetCifar(3, (32, 32), 10)
    network.bn1.eval()
    before, modes = copy.deepcopy(network.state_dict()), [m.training for m in network.modules()]
    network_cost(network, (32, 32), 3)
    assert [m.training for m in network.modules()] == modes
    assert all(torch.equal(before[key], value) for key, value in network.state_dict().items())
    assert not any(m._forward_hooks for m in network.modules())


def test_a_failing_network_is_left_as_it_was_too():
    network = nn.Sequential(nn.Conv2d(2, 3, 3), nn.Linear(5, 5))
    with pytest.raises(RuntimeError):
        network_cost(network, (9, 9), 2)
    assert network.training
    assert not any(m._forward_hooks for m in network.modules())


def test_what_has_no_rule_is_named():
    network = nn.Sequential(nn.ConvTranspose2d(1, 2, 3), nn.BatchNorm2d(2), nn.Conv2d(2, 1, 1))
    assert network_cost(network, (5, 5), 1).uncounted == ("0",)


def test_linear_layers_count_once_for_every_position():
    network = nn.Sequential(nn.Flatten(2), nn.Linear(6, 5), nn.Flatten(), nn.Linear(10, 4))
    cost = network_cost(network, (2, 3), 2)
    assert [layer.macs for layer in cost.layers] == [2 * 6 * 5, 10 * 4]
    assert [layer.path for layer in cost.layers] == ["1", "3"]


def test_frozen_parameters_are_no_parameters_of_training():
    network = nn.Sequential(nn.Conv2d(1, 2, 3, bias=False))
    network.requires_grad_(False)
    cost = network_cost(network, (3, 3), 1)
    assert (cost.parameters, cost.macs) == (0, 18)
