"""Queries in corrupted images beside the clean ones."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from sextant.chapters.places.data import ImageRows, PlaceImages, PlaceTolerance
from sextant.chapters.places.data.augmentation import PlaceAugmentation
from sextant.chapters.places.data.corrupted import CorruptedQueries
from sextant.chapters.places.invariance import condition_pairs
from sextant.chapters.places.task import mean_recall
from sextant.corruptions import BenchmarkSuite
from sextant.errors import UserError

SUITE = BenchmarkSuite("cifar10_c", ["gaussian_noise", "fog", "contrast"], [1, 5])


class Drives:
    """A map and a drive of seven places, whose frames are stored backwards."""

    name, place_unit = "drives", "m"

    def conditions(self, split):
        return ("map", "rain")

    def read(self, split):
        rng = np.random.default_rng(0)
        return PlaceImages(
            ImageRows(rng.integers(60, 200, (14, 32, 48, 3), np.uint8)),
            np.repeat([0, 1], 7),
            ("map", "rain"),
            np.r_[0:7, 6:-1:-1],
            tuple(f"{number}.png" for number in range(14)),
            position_m=np.c_[np.r_[0:7, 6:-1:-1], np.zeros(14)].astype(float),
        )


def test_a_drive_is_there_once_more_under_every_condition_in_turn():
    source = CorruptedQueries(Drives(), SUITE)
    clean, found = Drives().read("test"), source.read("test")
    assert source.conditions("test") == found.conditions == ("map", "rain", "rain_corrupted")
    assert np.array_equal(found.images[:14], clean.images[:])
    drive, corrupted = found.rows_of("rain"), found.rows_of("rain_corrupted")
    assert np.array_equal(found.position_m[drive], found.position_m[corrupted])
    keys = [key.split()[-1] for key in (found.names[row] for row in corrupted)]
    assert keys == [
        "gaussian_noise/1",
        "gaussian_noise/5",
        "fog/1",
        "fog/5",
        "contrast/1",
        "contrast/5",
        "gaussian_noise/1",
    ]
    for number, row in enumerate(drive):  # the very image that a classifier would be tested on
        image = torch.from_numpy(clean.images[row]).permute(2, 0, 1)[None].float() / 255
        expected = SUITE.corrupt(image, torch.tensor([row]), SUITE.conditions()[1:][number % 6])
        assert np.array_equal(
            found.images[corrupted[number]], (expected[0] * 255).round().permute(1, 2, 0).byte().numpy()
        )


class Stopping(Drives):
    """A drive that stands still for three frames, of which one is in a tunnel."""

    def read(self, split):
        clean = super().read(split)
        images = clean.images[:]
        drive = clean.rows_of("rain")
        images[drive[3]] = images[drive[4]] = images[drive[2]]
        images[drive[6]] = 128
        return replace(clean, images=ImageRows(images))


def test_copies_are_flat_and_still_where_the_originals_are():
    clean, found = Stopping().read("test"), CorruptedQueries(Stopping(), SUITE).read("test")
    drive, copy = found.rows_of("rain"), found.rows_of("rain_corrupted")
    for name in ("flat", "still"):
        assert np.array_equal(getattr(found, name)[:14], getattr(clean, name))
        assert np.array_equal(getattr(found, name)[copy], getattr(found, name)[drive])
        assert getattr(found, name)[copy].any()
    assert np.array_equal(found.select(copy).still, found.still[copy])


def test_an_image_is_not_matched_with_its_own_copy_and_means_are_of_originals():
    found = CorruptedQueries(Drives(), SUITE).read("test")
    assert found.originals == ("map", "rain")
    rng = np.random.default_rng(0)
    clean = rng.standard_normal((14, 8)).astype(np.float32)
    descriptors = np.vstack([clean, clean[found.rows_of("rain")][::-1]])  # copies are like their originals
    tolerance = PlaceTolerance("m", 0.5, 2.0)
    pairs = condition_pairs(descriptors, found, tolerance)
    assert pairs.conditions == ("map", "rain")
    alone = condition_pairs(clean, Drives().read("test"), tolerance)
    assert pairs.across == alone.across
    assert mean_recall(descriptors, found, tolerance) == mean_recall(clean, Drives().read("test"), tolerance)


def test_images_are_corrupted_once(monkeypatch):
    source, times = CorruptedQueries(Drives(), SUITE), []
    real = CorruptedQueries._corrupted
    monkeypatch.setattr(CorruptedQueries, "_corrupted", lambda self, *given: times.append(1) or real(self, *given))
    assert source.read("test") is source.read("test")
    assert len(times) == 1


def test_a_condition_of_the_same_name_is_refused():
    class Taken(Drives):
        def conditions(self, split):
            return ("map", "rain", "rain_corrupted")

    with pytest.raises(UserError, match="has a condition rain_corrupted of its own"):
        CorruptedQueries(Taken(), SUITE).conditions("test")


@pytest.mark.parametrize("split", ["train", "val"])
def test_training_and_validation_stay_clean(split):
    source = CorruptedQueries(Drives(), SUITE)
    assert source.conditions(split) == source.read(split).conditions == ("map", "rain")


def test_augmix_mixes_each_image_by_its_own_number():
    images = torch.from_numpy(Drives().read("train").images[:]).permute(0, 3, 1, 2)
    plain, mixing = PlaceAugmentation(), PlaceAugmentation(augmix=3)
    numbers = np.arange(14)
    mixed = mixing(images, numbers, seed=0)
    changed = (mixed.int() - plain(images, numbers, seed=0).int()).abs().float().mean((1, 2, 3))
    assert changed.median() > 2
    assert torch.equal(mixing(images[3:5], numbers[3:5], seed=0), mixed[3:5])
    assert not torch.equal(mixing(images[3:5], numbers[3:5] + 14, seed=0), mixed[3:5])
