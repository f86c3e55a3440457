import pytest
import torch

from sextant.models import FeatureMap, SmallVGG


def test_each_stage_halves_the_map_of_the_one_before():
    network = SmallVGG(1, (28, 30), 10, widths=(4, 8, 12), depths=(1, 2, 1)).eval()
    images = torch.rand(2, 1, 28, 30)
    maps = [FeatureMap(network, 1, (28, 30), layer=f"stages.{number}")(images) for number in (2, 1, 0)]
    assert [tuple(found.shape[1:]) for found in maps] == [(12, 7, 7), (8, 14, 15), (4, 28, 30)]


def test_has_so_many_convolutions_and_logits():
    network = SmallVGG(3, (16, 16), 5, widths=(4, 8), depths=(1, 3))
    assert sum(isinstance(module, torch.nn.Conv2d) for module in network.modules()) == 4
    assert network(torch.rand(2, 3, 16, 16)).shape == (2, 5)


@pytest.mark.parametrize(
    ("size", "depths", "message"),
    [((28, 28), (1, 2), "3 widths need as many depths"), ((28, 3), (1, 1, 1), "28x3 are too small for 3 stages")],
)
def test_what_cannot_be_built_is_refused(size, depths, message):
    with pytest.raises(ValueError, match=message):
        SmallVGG(1, size, 10, widths=(4, 8, 12), depths=depths)
