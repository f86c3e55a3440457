"""Queries in corrupted images beside the clean ones."""

import numpy as np
import pytest
import torch

from sextant.corruptions import BenchmarkSuite
from sextant.data.places import ImageRows, PlaceImages
from sextant.data.places.augmentation import PlaceAugmentation
from sextant.data.places.corrupted import CorruptedQueries

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
