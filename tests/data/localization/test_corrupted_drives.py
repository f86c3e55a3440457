"""Test drives under corruptions: the images of the suite at their own size, and nothing else changed.

The boundaries of the kind: each of the 19 corruptions; colour and grey; images of a few pixels, wider than high and
higher than wide; rows taken in any order, twice or not at all; drives without images; one drive and several.
"""

import numpy as np
import pytest
from data.localization.drives import circle

from sextant.chapters.localization.along_drives import for_validation
from sextant.chapters.localization.data import Drive
from sextant.chapters.localization.data.corrupted_drives import CorruptedDrives, CorruptedRows
from sextant.chapters.localization.data.described import DescribedDrives
from sextant.chapters.localization.data.drive import LocalizationData
from sextant.chapters.localization.data.faults import WrongSeasonMap
from sextant.chapters.places.data import ImageRows
from sextant.corruptions import BenchmarkSuite, CorruptionSuite, GaussianNoise
from sextant.corruptions.suite import Condition
from sextant.evaluation import ALL_19


def pictures(n=6, height=24, width=36, channels=3, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (n, height, width, channels), dtype=np.uint8)


class Source:
    """Drives in memory."""

    name = "made_up"

    def __init__(self, *test):
        self.test = test or (circle(10, name="run", condition="night"),)

    def conditions(self):
        return ("day", "night")

    def files(self, split):
        return []

    def fingerprint(self):
        return "made up"

    def read(self):
        validation = (circle(8, name="before", condition="night"),)
        other = (circle(12, name="night map", condition="night"),)
        return LocalizationData(circle(20), self.test, validation, None, "m", "office", other_maps=other)


def under(suite, *test, named="suite"):
    return CorruptedDrives(Source(*test), suite, named)


@pytest.mark.parametrize("name", ALL_19)
@pytest.mark.parametrize(("height", "width", "channels"), [(24, 36, 3), (40, 16, 1)], ids=["wide colour", "high grey"])
def test_images_are_those_of_the_suite_at_their_own_size(name, height, width, channels):
    suite = BenchmarkSuite("imagenet_c", [name], severities=[2])
    seen = pictures(3, height, width, channels)
    rows = CorruptedRows(ImageRows(seen), np.arange(3) + 5, suite, Condition(name, 2), "suite")
    assert rows.shape == seen.shape
    expected = suite.corrupt_bytes(seen, np.arange(3) + 5, Condition(name, 2))
    np.testing.assert_array_equal(rows[:], expected)
    np.testing.assert_array_equal(rows[2], expected[2])  # one by one as together
    assert (expected != seen).any() or (name, channels) == ("saturate", 1)  # grey has no colours to saturate


@pytest.mark.parametrize(
    "taken",
    [[0], [5, 0, 3], [2, 2, 2], [], [True, False] * 3, slice(1, 5, 2), slice(0, 0), -1],
    ids=["one", "any order", "repeated", "none", "mask", "stretch", "empty stretch", "the last"],
)
def test_rows_in_any_order_keep_their_own_noise(taken):
    suite = BenchmarkSuite("cifar10_c", ["gaussian_noise"], severities=[5])
    rows = CorruptedRows(ImageRows(pictures()), np.arange(6), suite, Condition("gaussian_noise", 5), "suite")
    whole, key = rows[:], np.array(taken) if isinstance(taken, list) and taken else taken
    key = np.zeros(0, np.int64) if isinstance(taken, list) and not taken else key
    np.testing.assert_array_equal(rows[key], whole[key])
    if isinstance(taken, list):
        np.testing.assert_array_equal(rows.select(key)[:], whole[key])


def test_every_drive_is_once_more_under_each_condition_and_all_else_stays():
    suite = BenchmarkSuite("cifar10_c", ["fog", "contrast"], severities=[1, 3])
    runs = circle(10, name="run", condition="night"), circle(9, name="other", condition="day")
    found, clean = under(suite, *runs).read(), Source(*runs).read()
    assert found.test == runs
    assert [drive.name for drive in found.corrupted[:4]] == [
        "run, fog/1",
        "run, fog/3",
        "run, contrast/1",
        "run, contrast/3",
    ]
    assert [drive.corruption for drive in found.corrupted] == ["fog/1", "fog/3", "contrast/1", "contrast/3"] * 2
    for one, drive in zip(found.corrupted, [runs[0]] * 4 + [runs[1]] * 4, strict=True):
        assert one.condition == drive.condition
        np.testing.assert_array_equal(one.poses, drive.poses)
        np.testing.assert_array_equal(one.motion, drive.motion)
    for name in ("map", "validation", "other_maps"):
        for one, before in zip(*[np.atleast_1d(getattr(data, name)) for data in (found, clean)], strict=True):
            np.testing.assert_array_equal(one.images[:], before.images[:])
    assert for_validation(found).corrupted == ()


def test_no_two_images_of_the_test_share_a_draw():
    suite = CorruptionSuite({"gaussian": GaussianNoise([0.1], clip=True)})
    same = [circle(5, name=name) for name in ("one", "two")]
    one, two = (drive.images[:] for drive in under(suite, *same).read().corrupted)
    assert (one != two).any()
    assert (one[0] != one[1]).any()


def test_a_drive_without_images_is_left_out():
    blind = Drive.of("blind", "dark", circle(4).poses)
    suite = BenchmarkSuite("cifar10_c", ["fog"], severities=[1])
    assert [drive.name for drive in under(suite, blind, circle(5, name="run")).read().corrupted] == ["run, fog/1"]


def test_drives_of_the_maps_condition_are_left_out_with_their_copies():
    suite = BenchmarkSuite("cifar10_c", ["fog"], severities=[1])
    runs = circle(10, name="run", condition="night"), circle(9, name="other", condition="dusk")
    changed = WrongSeasonMap("night").data(under(suite, *runs).read())
    assert [drive.name for drive in (*changed.test, *changed.corrupted)] == ["other", "other, fog/1"]


class Mean:
    """Describes an image by its mean."""

    identity = "mean"

    def fit(self, images):
        pass

    def describe(self, images):
        return images.reshape(len(images), -1).mean(axis=1, keepdims=True).astype(np.float32)


@pytest.mark.parametrize(
    "other",
    [
        {"seed": 1}, {"severities": [2]}, {"names": ["snow"]}, {"set": "imagenet_c"}, {"mode": "corrected"},
        {"quantise": False}, {"named": "another"},
    ],
    ids=lambda other: next(iter(other)),
)  # fmt: skip
def test_kept_descriptors_are_not_taken_for_those_of_another_suite(tmp_path, other):
    def described(named="suite", set="cifar10_c", names=("frost",), severities=(3,), **options):
        suite = BenchmarkSuite(set, list(names), list(severities), **options)
        data = under(suite, named=f"{named} {set} {options}").read()
        keeper = DescribedDrives(Mean(), "made up", tmp_path)
        keeper.fit(data.map)
        return np.array(keeper.of(data.corrupted[0])), np.array(keeper.of(data.test[0]))

    one, clean = described()
    kept = set(tmp_path.glob("descriptors-*.npy"))
    again, _ = described()
    np.testing.assert_array_equal(one, again)
    assert set(tmp_path.glob("descriptors-*.npy")) == kept
    described(**other)
    assert len(set(tmp_path.glob("descriptors-*.npy")) - kept) == 1  # that of the clean drive serves on
    assert (one != clean).any()
