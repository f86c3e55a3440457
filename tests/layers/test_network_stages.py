"""Which convolutions the first stage of well-known networks has."""

import pytest
import torch
from torch import nn

from sextant.layers import PushPullInhibition, first_stage_convs, inhibited
from sextant.models import LeNet


def paths(template, *numbers):
    return [template.format(*(number if isinstance(number, tuple) else (number,))) for number in numbers]


FIRST_STAGES = {
    "resnet18": paths("layer1.{}.conv{}", (0, 1), (0, 2), (1, 1), (1, 2)),
    "resnet50": paths("layer1.{}.conv2", 0, 1, 2),
    "densenet121": paths("features.denseblock1.denselayer{}.conv2", *range(1, 7)),
    "mobilenet_v2": ["features.1.conv.0.0"],
    "vgg11": ["features.3"],
    "vgg16_bn": ["features.3"],
    "alexnet": ["features.3"],
    "convnext_tiny": paths("features.1.{}.block.0", 0, 1, 2),
}


@pytest.mark.parametrize(("name", "expected"), FIRST_STAGES.items(), ids=FIRST_STAGES)
def test_the_first_stage_of_torchvision_networks(name, expected):
    from torchvision.models import get_model

    with torch.device("meta"):
        network = get_model(name, weights=None)
    assert first_stage_convs(network) == expected


TIMM_FIRST_STAGES = {
    "resnet18d": paths("layer1.{}.conv{}", (0, 1), (0, 2), (1, 1), (1, 2)),  # its stem has three convolutions
    "densenet121": paths("features.denseblock1.denselayer{}.conv2", *range(1, 7)),
    "mobilenetv3_small_100": ["blocks.0.0.conv_dw"],
    "regnetx_002": ["s1.b1.conv2.conv"],
}


@pytest.mark.parametrize(("name", "expected"), TIMM_FIRST_STAGES.items(), ids=TIMM_FIRST_STAGES)
def test_the_first_stage_of_timm_networks(name, expected):
    timm = pytest.importorskip("timm")
    with torch.device("meta"):
        network = timm.create_model(name, pretrained=False)
    assert first_stage_convs(network) == expected


def test_first_block_inhibits_the_first_stage_and_leaves_the_stem():
    from torchvision.models import resnet18

    network = resnet18(weights=None)
    state = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    modes = [module.training for module in network.modules()]
    PushPullInhibition(where="first_block")(network)
    assert inhibited(network) == FIRST_STAGES["resnet18"]
    assert all(torch.equal(tensor, state[name]) for name, tensor in network.state_dict().items())
    assert [module.training for module in network.modules()] == modes
    assert not any(module._forward_hooks for module in network.modules())
    assert network(torch.zeros(2, 3, 32, 32)).shape == (2, 1000)


def test_a_classifier_for_another_image_size_does_not_matter():
    lenet = LeNet("A", 1, (28, 28), 10)
    first, second = (path for path, module in lenet.named_modules() if isinstance(module, nn.Conv2d))
    assert first_stage_convs(lenet) == [second]
    assert first != second


def test_the_stage_ends_where_the_resolution_changes_even_if_it_returns():
    network = nn.Sequential(
        nn.Conv2d(1, 2, 3, padding=1),
        nn.Conv2d(2, 2, 3, padding=1),
        nn.Conv2d(2, 2, 1),
        nn.Conv2d(2, 2, 5, padding=2),
        nn.Conv2d(2, 2, 3, 2, padding=1),
        nn.Upsample(scale_factor=2),
        nn.Conv2d(2, 2, 3, padding=1),
    )
    assert first_stage_convs(network) == ["1", "3"]


@pytest.mark.parametrize("layers", [[nn.Conv2d(1, 2, 3)], [nn.Conv2d(1, 2, 3), nn.Conv2d(2, 2, 1)], [nn.ReLU()]])
def test_a_network_without_a_stage_after_its_stem_is_refused(layers):
    with pytest.raises(ValueError, match="no convolution larger than 1x1 after its stem"):
        first_stage_convs(nn.Sequential(*layers))
