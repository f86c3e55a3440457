import pytest
import torch
import torch.nn.functional as F
from torch import nn

from sextant.layers import NoInhibition, PushPullConv2d, PushPullInhibition, first_conv
from sextant.models import LeNet


def nested_network():
    stem = nn.Sequential(nn.BatchNorm2d(3), nn.Conv2d(3, 4, 3))
    return nn.ModuleDict({"stem": stem, "body": nn.Conv2d(4, 5, 3)})


def trained(inhibition):
    """Weights before and after a few steps; images are drawn after the surgery, which must not use the generator."""
    torch.manual_seed(0)
    network = inhibition(LeNet("A", 1, (28, 28), 10))
    start = {name: weight.clone() for name, weight in network.state_dict().items()}
    optimizer = torch.optim.SGD(network.parameters(), lr=0.1, momentum=0.9, nesterov=True, weight_decay=5e-4)
    for _ in range(5):
        optimizer.zero_grad()
        F.cross_entropy(network(torch.rand(16, 1, 28, 28)), torch.randint(10, (16,))).backward()
        optimizer.step()
    return start, network.state_dict()


def same(first, second):
    return first.keys() == second.keys() and all(torch.equal(first[name], second[name]) for name in first)


def test_the_first_convolution_in_registration_order_is_found_at_any_depth():
    network = nested_network()
    path, conv = first_conv(network)
    assert path == "stem.1"
    assert conv is network["stem"][1]


def test_only_the_first_convolution_is_replaced_and_keeps_its_weights():
    network = nested_network()
    first, second = network["stem"][1], network["body"]
    assert PushPullInhibition(scale=1.5, alpha=0.5)(network) is network
    layer = network["stem"][1]
    assert isinstance(layer, PushPullConv2d)
    assert (layer.scale, layer.alpha) == (1.5, 0.5)
    assert layer.weight is first.weight
    assert network["body"] is second


def test_trained_strengths_are_parameters_of_the_network():
    network = PushPullInhibition(train_alpha=True)(nested_network())
    assert dict(network.named_parameters())["stem.1.alpha"].shape == (4,)


def test_no_inhibition_leaves_the_network_as_it_is():
    network = nested_network()
    modules = list(network.modules())
    assert NoInhibition()(network) is network
    assert list(network.modules()) == modules


@pytest.mark.parametrize("network", [nn.Sequential(nn.Flatten(), nn.Linear(4, 2)), nn.Conv2d(1, 1, 3)])
@pytest.mark.parametrize("find", [first_conv, PushPullInhibition()])
def test_a_network_without_a_convolution_inside_is_refused(find, network):
    with pytest.raises(ValueError, match=f"{type(network).__name__} has no Conv2d"):
        find(network)


def test_training_the_twin_is_training_the_network_without_inhibition():
    start, plain = trained(NoInhibition())
    twin_start, twin = trained(PushPullInhibition(scale=1.0, alpha=1.0))
    assert same(twin_start, start)
    assert same(twin, plain)
    assert not same(plain, start)


def test_training_with_inhibition_starts_from_the_same_weights_and_ends_elsewhere():
    start, plain = trained(NoInhibition())
    inhibited_start, inhibited = trained(PushPullInhibition())
    assert same(inhibited_start, start)
    assert not same(inhibited, plain)
