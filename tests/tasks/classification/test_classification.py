"""What the module of a classifier tells of its network."""

from torch import nn

from sextant.chapters.classification.task import Classification
from sextant.corruptions import CorruptionSuite
from sextant.data.source import ImageSpec
from sextant.layers import PushPullInhibition

SPEC = ImageSpec(1, 9, 9, ("a", "b"))


def classifier(where):
    convolutions = (nn.Conv2d(1, 4, 3), nn.Conv2d(4, 2, 1), nn.AdaptiveAvgPool2d(1), nn.Flatten())
    return Classification(PushPullInhibition(where=where)(nn.Sequential(*convolutions)), SPEC, CorruptionSuite())


def test_a_run_records_the_convolutions_that_were_to_be_inhibited_and_were_not():
    cost = classifier("all").facts()["cost"]
    assert cost["without_inhibition"] == {"1": "a 1x1 kernel has no pattern in space"}
    assert cost["inhibition"].keys() == {"0"}
    assert "without_inhibition" not in classifier("first").facts()["cost"]
