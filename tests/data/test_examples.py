"""Which images a network, filters and machines learn from: apart from each other, even, by the seed."""

import re

import numpy as np
import pytest

from sextant.data.examples import ExampleData, ExampleSettings
from sextant.data.source import ImageSource, ImageSpec, LabelledImages
from sextant.errors import UserError

COUNTS = (30, 20, 12, 40, 25)


class Numbered(ImageSource):
    """Images that hold their number in the split; tests come after 200. Classes of unlike sizes, mixed."""

    name = "numbered"

    def files(self, split):
        return []

    def spec(self):
        return ImageSpec(1, 2, 2, tuple("abcde"))

    def read(self, split):
        labels = np.repeat(np.arange(5), COUNTS if split == "train" else 4)
        labels = np.random.default_rng(1).permutation(labels)
        numbers = np.arange(len(labels), dtype=np.uint8) + (200 if split == "test" else 0)
        return LabelledImages(np.broadcast_to(numbers[:, None, None, None], (len(labels), 1, 2, 2)).copy(), labels)


def data(seed=0, source=None, **settings):
    module = ExampleData(
        source or Numbered(), batch_size=8, eval_batch_size=8, validation_fraction=0.2, split_seed=0, seed=seed,
        settings=ExampleSettings(**settings),
    )  # fmt: skip
    module.setup("fit")
    module.setup("test")
    return module


def numbers(module, split):
    return module.split(split).images[:, 0, 0, 0].tolist()


def counts(module, split):
    return np.bincount(module.split(split).labels, minlength=5).tolist()


def test_all_images_are_examples_but_those_that_are_held_out():
    module = data()
    assert numbers(module, "train") == numbers(module, "examples")
    assert numbers(module, "validation") == numbers(module, "tuning")
    assert sorted(numbers(module, "train") + numbers(module, "validation")) == list(range(sum(COUNTS)))
    assert counts(module, "validation") == [round(0.2 * count) for count in COUNTS]
    assert numbers(module, "test") == list(range(200, 220))
    assert module.tested == module.learnt == list(range(5))


def test_labels_stay_with_their_images():
    labels = Numbered().read("train").labels
    module = data(images=40, examples=3)
    for split in ("train", "validation", "examples", "tuning"):
        assert labels[numbers(module, split)].tolist() == module.split(split).labels.tolist()


def test_so_many_images_as_even_as_can_be():
    whole = set(numbers(data(), "train"))
    for images, expected in ((40, [8] * 5), (42, [9, 9, 8, 8, 8]), (60, [13, 13, 10, 12, 12]), (102, None)):
        module = data(images=images)
        assert len(set(numbers(module, "train"))) == images
        assert set(numbers(module, "train")) <= whole
        found = counts(module, "train")
        full = [count - round(0.2 * count) for count in COUNTS]
        assert max(found) - min(f for f, most in zip(found, full, strict=True) if f < most or most >= max(found)) <= 1
        if expected is not None:
            assert found == expected


def test_so_many_examples_of_each_class():
    module = data(examples=4)
    assert counts(module, "examples") == [4] * 5
    assert set(numbers(module, "examples")) <= set(numbers(module, "train"))
    assert len(numbers(module, "train")) == len(numbers(data(), "train"))


def test_the_seed_chooses_images_and_never_what_is_held_out():
    one, same, other = (data(seed, images=40, examples=2) for seed in (3, 3, 4))
    for split in ("train", "examples"):
        assert numbers(one, split) == numbers(same, split)
        assert set(numbers(one, split)) != set(numbers(other, split))
    assert numbers(one, "validation") == numbers(other, "validation")
    assert not set(numbers(one, "train")) & set(numbers(one, "validation"))


def test_more_images_take_in_the_fewer_ones():
    fewer, more = (set(numbers(data(5, images=images), "train")) for images in (20, 50))
    assert fewer < more


def test_novel_classes_are_kept_from_the_network():
    module = data(novel_classes=2, examples=5)
    assert (module.learnt, module.tested) == ([0, 1, 2], [3, 4])
    for split, classes in (("train", [0, 1, 2]), ("validation", [0, 1, 2]), ("examples", [3, 4]), ("tuning", [3, 4])):
        assert set(module.split(split).labels.tolist()) == set(classes)
    assert set(module.split("test").labels.tolist()) == {3, 4}
    assert counts(module, "examples") == [0, 0, 0, 5, 5]
    assert not set(numbers(module, "examples")) & set(numbers(module, "tuning"))


def test_without_any_held_out_all_are_examples():
    module = data(held_out=False)
    assert numbers(module, "examples") == numbers(module, "train") == list(range(sum(COUNTS)))
    assert len(module.split("tuning")) == 0
    assert module.split("tuning").images.shape == (0, 1, 2, 2)


def test_a_test_alone_reads_no_training_images():
    source = Numbered()
    read, asked = source.read, []
    source.read = lambda split: asked.append(split) or read(split)
    module = ExampleData(
        source, batch_size=8, eval_batch_size=8, validation_fraction=0.2, split_seed=0, seed=0,
        settings=ExampleSettings(images=10**6),
    )  # fmt: skip
    module.setup("test")
    assert asked == ["test"]
    assert module.test_conditions() == {}


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"images": 103}, "images=103: dataset=numbered has 102 training images, and 25 held out"),
        ({"examples": 11}, "examples=11: there are 10 training images of class c to choose from"),
        ({"images": 10, "examples": 3}, "examples=3: there are 2 training images of class a"),
        ({"images": 4, "examples": 1}, "examples=1: there are 0 training images of class e"),
    ],
)
def test_fewer_than_are_asked_for(settings, says):
    with pytest.raises(UserError, match=re.escape(says)):
        data(**settings)
