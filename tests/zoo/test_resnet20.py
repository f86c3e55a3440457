"""The two ResNets that come with the package: what they know, and that their cards are right."""

import numpy as np
import pytest

from sextant import ImageClassifier
from sextant.data.cifar10 import CIFAR10, CLASSES
from sextant.zoo import model_file, read_card

NAMES = ("resnet20", "resnet20_push_pull")


def card(name):
    return read_card(model_file(f"zoo:{name}"))


def test_they_differ_in_the_inhibition_alone():
    plain, push_pull = (card(name)["model"] for name in NAMES)
    assert plain["config"].pop("inhibition") != push_pull["config"].pop("inhibition")
    assert plain == push_pull


@pytest.mark.parametrize("name", NAMES)
def test_it_opens_where_there_is_no_gpu_and_says_what_it_sees(name):
    assert card(name)["model"]["config"]["trainer"]["accelerator"] == "cpu"
    found = ImageClassifier.load(f"zoo:{name}").classify(np.zeros((32, 32, 3), np.uint8))
    assert found.label in CLASSES


@pytest.mark.slow
@pytest.mark.real_data
@pytest.mark.parametrize("name", NAMES)
def test_its_card_tells_what_it_scores(name, real_data):
    test = CIFAR10([real_data]).read("test")
    found = ImageClassifier.load(f"zoo:{name}").classify_many(list(test.images[::5].transpose(0, 2, 3, 1)))
    error = np.mean([CLASSES.index(each.label) for each in found] != test.labels[::5])
    assert error == pytest.approx(card(name)["metrics"]["error"]["clean"], abs=2e-3)
