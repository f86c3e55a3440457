"""The two digit networks that come with the package: they serve wherever a run is taken, and their cards are right."""

import csv

import numpy as np
import pytest
from PIL import Image

from sextant import ImageClassifier, cli
from sextant.data.digits import Digits
from sextant.data.mnist import MNIST
from sextant.tools.demonstration.digit import centred
from sextant.zoo import model_file, read_card

NAMES = ("digits", "digits_push_pull")


def card(name):
    return read_card(model_file(f"zoo:{name}"))


def test_together_they_take_less_than_a_megabyte():
    assert sum(model_file(f"zoo:{name}").stat().st_size for name in NAMES) < 1e6


def test_they_differ_in_the_inhibition_alone():
    plain, push_pull = (card(name)["model"] for name in NAMES)
    assert plain["config"].pop("inhibition") != push_pull["config"].pop("inhibition")
    assert plain == push_pull


@pytest.mark.parametrize("name", NAMES)
def test_it_reads_digits_of_other_writers(name):
    scans = Digits(28).read("test")
    framed = [centred(scan)[..., None] for scan in scans.images[:, 0]]  # MNIST's digits are smaller in their frame
    found = ImageClassifier.load(f"zoo:{name}").classify_many(framed)
    assert np.mean([int(each.label) for each in found] == scans.labels) > 0.85


def test_a_command_takes_it_for_a_run(tmp_path):
    two = Digits(28).read("test")
    for label in (0, 7):
        digit = centred(two.images[int((two.labels == label).argmax()), 0])
        Image.fromarray(digit).save(tmp_path / f"{label}.png")
    cli.run("predict", ["run=zoo:digits", f"input={tmp_path}", f"output={tmp_path / 'found'}"])
    rows = list(csv.DictReader((tmp_path / "found" / "predictions.csv").open()))
    assert [row["class"] for row in rows] == ["0", "7"]


@pytest.mark.real_data
@pytest.mark.parametrize("name", NAMES)
def test_its_card_tells_what_it_scores(name, real_data):
    test = MNIST([real_data]).read("test")
    classifier = ImageClassifier.load(f"zoo:{name}")
    found = classifier.classify_many(list(test.images[::10].transpose(0, 2, 3, 1)))
    error = np.mean([int(each.label) for each in found] != test.labels[::10])
    assert error == pytest.approx(card(name)["metrics"]["error"]["clean"], abs=1e-3)
