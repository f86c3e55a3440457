"""Descriptors of drives are worked out once, kept whole or not at all, and never taken for those of another."""

import errno

import numpy as np
import pytest
from data.localization.drives import circle, numbers

from sextant.chapters.localization.data import described
from sextant.chapters.localization.data.described import DescribedDrives
from sextant.chapters.localization.data.drive import Drive
from sextant.chapters.places.descriptors import Describer
from sextant.errors import UserError


class Means:
    """Describes an image by the mean of its pixels less that of the map; counts the images that it saw."""

    def __init__(self, identity="means"):
        self.identity, self.seen, self.fits, self.offset = identity, 0, 0, None

    def fit(self, images):
        self.fits, self.offset = self.fits + 1, float(images[:].mean())

    def describe(self, images):
        self.seen += len(images)
        mean = images.reshape(len(images), -1).mean(axis=1) - self.offset
        return np.stack([mean, -mean], axis=1).astype(np.float32)


@pytest.fixture
def drives(tmp_path):
    def of(describer, dataset="office", mapped=None):
        found = DescribedDrives(describer, dataset, tmp_path / "cache")
        found.fit(circle(name="map") if mapped is None else mapped)
        return found

    return of


def test_rows_are_those_of_the_images(drives):
    drive = circle(25, name="run").take(np.array([3, 20, 3, 7]))
    describer = Means()
    assert isinstance(describer, Describer)
    found = drives(describer).of(drive)
    np.testing.assert_allclose(found[:, 0], numbers(drive) - np.mean(range(40)), rtol=1e-6)
    assert not found.flags.writeable


def test_they_are_worked_out_once_by_batches(drives, monkeypatch):
    monkeypatch.setattr(described, "BATCH", 7)
    first, second = Means(), Means()
    whole = np.array(drives(first).of(circle(25, name="run")))
    assert (first.seen, first.fits) == (25, 1)
    np.testing.assert_array_equal(drives(second).of(circle(25, name="run")), whole)
    assert (second.seen, second.fits) == (0, 0)  # a descriptor that learns from the map need not even do that


@pytest.mark.parametrize(
    "other",
    [
        {"describer": "medians"},
        {"dataset": "town"},
        {"mapped": circle(30, name="map")},
        {"drive": circle(24, name="run")},
        {"drive": circle(25, name="run", condition="night")},
        {"drive": circle(25, name="run").take(np.arange(25)[::-1].copy())},
    ],
    ids=["descriptor", "dataset", "map", "images", "condition", "order"],
)
def test_what_is_kept_belongs_to_descriptor_dataset_map_and_images(drives, other):
    drives(Means()).of(circle(25, name="run"))
    again = Means(other.get("describer", "means"))
    found = drives(again, other.get("dataset", "office"), other.get("mapped"))
    drive = other.get("drive", circle(25, name="run"))
    found.of(drive)
    assert again.seen == len(drive)


def test_nothing_is_kept_of_what_failed(drives, tmp_path, monkeypatch):
    class Failing(Means):
        def describe(self, images):
            if self.seen:
                raise RuntimeError("out of memory")
            return super().describe(images)

    monkeypatch.setattr(described, "BATCH", 10)
    with pytest.raises(RuntimeError, match="out of memory"):
        drives(Failing()).of(circle(25, name="run"))
    assert list((tmp_path / "cache").iterdir()) == []
    sound = Means()
    assert len(drives(sound).of(circle(25, name="run"))) == 25


def test_a_full_disk_is_told_and_leaves_nothing(drives, tmp_path, monkeypatch):
    def full(file, *arguments):
        file.write(b"a part of it")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np.lib.format, "write_array_header_1_0", full)
    with pytest.raises(UserError, match=r"descriptors cannot be stored there: .*No space left[\s\S]*paths\.cache="):
        drives(Means()).of(circle(25, name="run"))
    assert list((tmp_path / "cache").iterdir()) == []


def test_altered_descriptors_are_worked_out_again(drives, tmp_path):
    whole = np.array(drives(Means()).of(circle(25, name="run")))
    (path,) = (tmp_path / "cache").glob("*.npy")
    content = bytearray(path.read_bytes())
    content[-2] ^= 1
    path.write_bytes(content)
    again = Means()
    np.testing.assert_array_equal(drives(again).of(circle(25, name="run")), whole)
    assert again.seen == 25


def test_a_drive_without_images_is_named(drives):
    blind = Drive.of("blind", "day", np.zeros((4, 3)))
    with pytest.raises(UserError, match=r"the drive blind has no images[\s\S]*descriptor=file"):
        drives(Means()).of(blind)


def test_progress_is_told_of_each_drive(tmp_path, monkeypatch):
    from contextlib import contextmanager

    told = []

    @contextmanager
    def show(what):
        yield lambda done, total: told.append((what, done, total))

    monkeypatch.setattr(described, "BATCH", 10)
    found = DescribedDrives(Means(), "office", tmp_path, show)
    found.fit(circle(name="map"))
    found.of(circle(25, name="run"))
    assert told == [("describing run", done, 25) for done in (10, 20, 25)]
