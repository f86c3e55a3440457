"""Which rows of the map a step of training sees."""

import numpy as np
import pytest
import torch
from data.localization.drives import circle

from sextant.chapters.localization.data.datamodule import LocalizationDataModule
from sextant.chapters.localization.data.drive import LocalizationData


class Circles:
    """A dataset; counts how often it was read."""

    name = "circles"

    def __init__(self):
        self.reads = 0

    def conditions(self):
        return ("day",)

    def files(self, split):
        return []

    def fingerprint(self):
        return "circles"

    def read(self):
        self.reads += 1
        return LocalizationData(
            circle(name="map"), (circle(20, name="run"),), (circle(10, name="val"),), None, "m", "office"
        )


class Vectors:
    def of(self, drive, count):
        return np.full((count, 3), len(drive), np.float32)


def module(tmp_path, describer=None, **more):
    return LocalizationDataModule(Circles(), describer or Vectors(), tmp_path, **{"images": 15, "steps": 4} | more)


def test_drives_are_read_once(tmp_path):
    data = module(tmp_path)
    assert data.source.reads == 0
    assert data.drives.map is data.drives.map
    assert data.dimension == 3
    assert data.source.reads == 1


def test_the_same_images_in_every_step_spread_over_the_map(tmp_path):
    steps = module(tmp_path).choices(0)
    assert len(steps) == 4
    for rows in steps:
        np.testing.assert_array_equal(rows, steps[0])
    assert (steps[0][0], steps[0][-1], len(steps[0])) == (0, 39, 15)
    assert np.ptp(np.diff(steps[0])) <= 1
    np.testing.assert_array_equal(module(tmp_path).choices(9)[0], steps[0])


def test_all_images_where_there_are_fewer(tmp_path):
    for fixed in (True, False):
        np.testing.assert_array_equal(module(tmp_path, images=1000, fixed=fixed).choices(0)[0], np.arange(40))


def test_other_images_in_every_step_a_function_of_seed_and_epoch(tmp_path):
    steps = module(tmp_path, fixed=False).choices(3)
    assert all(len(np.unique(rows)) == 15 and (np.diff(rows) > 0).all() for rows in steps)
    assert any((steps[0] != rows).any() for rows in steps[1:])
    again = module(tmp_path, fixed=False).choices(3)
    for one, other in zip(steps, again, strict=True):
        np.testing.assert_array_equal(one, other)
    for changed in (module(tmp_path, fixed=False).choices(4), module(tmp_path, fixed=False, seed=1).choices(3)):
        assert any((one != other).any() for one, other in zip(steps, changed, strict=True))


def test_every_image_is_seen_at_last(tmp_path):
    data = module(tmp_path, fixed=False)
    seen = np.concatenate([np.concatenate(data.choices(epoch)) for epoch in range(5)])
    assert set(seen.tolist()) == set(range(40))


def test_loaders_give_rows_as_tensors(tmp_path):
    data = module(tmp_path)
    batches = list(data.train_dataloader())
    assert len(batches) == 4
    assert batches[0].dtype == torch.int64
    assert torch.equal(batches[0], torch.from_numpy(data.choices(0)[0]))
    assert len(list(data.val_dataloader())) == len(list(data.test_dataloader())) == 1


def test_descriptors_are_those_of_files_or_of_a_describer(tmp_path):
    class Described:
        identity = "numbers"
        fits = 0

        def fit(self, images):
            self.fits += 1

        def describe(self, images):
            return images[:, 0, 0, :1].astype(np.float32)

    files, images = module(tmp_path), module(tmp_path, Described())
    assert files.descriptors(files.drives.test[0]) == pytest.approx(np.full((20, 3), len("run")))
    np.testing.assert_array_equal(images.descriptors(images.drives.test[0])[:, 0], np.arange(20))
    images.descriptors(images.drives.validation[0])
    assert images.describer.fits == 1  # on the map alone
    assert images.dimension == 1
