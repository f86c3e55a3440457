"""The rule that chooses an implementation, and the table it reads."""

import itertools

import pytest
import torch
from torch import nn

from sextant.layers import PushPullAvgConv2d, PushPullConv2d, implementations
from sextant.layers.implementation import LEAST_GAIN, PullShape, _table, choose_implementation
from sextant.layers.strength import pull_kernel_size

SHAPE = {"in_channels": 3, "out_channels": 16, "groups": 1}


def square(kernel=3, pull=7, stride=1, size=32, **counts):
    sides = {"kernel": kernel, "pull": pull, "stride": stride, "size": size}
    return PullShape(**{name: (side, side) for name, side in sides.items()}, **(SHAPE | counts))


def test_the_table_holds_positive_times_of_every_implementation_and_each_shape_once():
    shapes = [shape for shape, _ in _table()]
    assert len(set(shapes)) == len(shapes)
    for shape, times in _table():
        assert times.keys() == {"direct", "rows", "factorised"}
        assert min(times.values()) > 0
        assert shape.pull[0] in {pull_kernel_size(shape.kernel[0], scale) for scale in (1.5, 2.0)}


def test_a_measured_shape_takes_what_was_fastest_there_unless_direct_is_about_as_fast():
    for shape, times in _table():
        chosen = choose_implementation(shape)
        best = min(times.values())
        assert times[chosen] == best or (chosen == "direct" and times["direct"] * (1 - LEAST_GAIN) < best)


@pytest.mark.parametrize("size", [28, 33, 100, 224, 500])
def test_every_shape_has_an_implementation_and_always_the_same(size):
    for kernel, channels in itertools.product([3, 5, 9], [1, 3, 50, 1000]):
        shape = square(kernel, 2 * kernel + 1, size=size, in_channels=channels)
        assert choose_implementation(shape) in ("direct", "rows", "factorised")
        assert choose_implementation(shape) == choose_implementation.__wrapped__(shape)


@pytest.mark.parametrize(
    ("kernel", "stride", "size", "channels", "fastest"),
    [
        (3, 1, 32, (3, 16), "rows"),
        (7, 2, 224, (3, 64), "rows"),
        (3, 1, 56, (64, 64), "rows"),
        (3, 1, 28, (128, 128), "rows"),
        (3, 1, 7, (512, 512), "factorised"),
    ],
)
def test_layers_of_known_networks_take_the_form_that_the_benchmark_finds_fastest(
    kernel, stride, size, channels, fastest
):
    layer = PushPullConv2d(*channels, kernel, stride, kernel // 2)
    assert layer.implementation(size, size) == fastest


def test_a_run_can_record_what_each_layer_takes_and_the_network_is_as_before():
    torch.manual_seed(0)
    network = nn.Sequential(
        PushPullConv2d(3, 16, 3, padding=1),
        nn.BatchNorm2d(16),
        nn.MaxPool2d(2),
        PushPullConv2d(16, 4, 3, impl="rows"),
        PushPullAvgConv2d(4, 2, 3),
    )
    network[1].eval()
    modes = [module.training for module in network.modules()]
    taken = implementations(network, torch.zeros(2, 3, 20, 24))
    assert taken == {"0": network[0].implementation(20, 24), "3": "rows", "4": "box"}
    assert [module.training for module in network.modules()] == modes
    assert not any(module._forward_pre_hooks for module in network.modules())
