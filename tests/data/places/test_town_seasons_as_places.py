"""The rendered town as places; datasets that have none."""

from contextlib import nullcontext

import numpy as np
import pytest

from sextant.chapters.places.data import ConditionSplit, ConditionSplitSource, PlaceTolerance, as_place_source
from sextant.chapters.places.data.source import rendered_place_source
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.data.digits import Digits
from sextant.data.rendered import open_store
from sextant.data.worlds import OfficeWalk, TownSeasons
from sextant.data.worlds.towns import TownSeasonsPlan
from sextant.errors import UserError

TOWN = {
    "frames": {"train": 6, "val": 2, "test": 3}, "step_m": 4.0, "lateral_sigma_m": 0.3, "heading_sigma_deg": 2.0,
    "width": 24, "height": 16, "vfov_deg": 55.0, "samples": 1, "conditions": ["summer_noon", "winter_noon"],
    "block_m": 70.0, "trajectories": {"train": None, "val": None, "test": None}, "seed": 3,
}  # fmt: skip


def painted(self, start, stop):
    """In place of the renderer, which its own tests look at: pictures that tell their number."""
    numbers = np.arange(start, stop, dtype=np.uint8)[:, None, None, None]
    return {"images": np.broadcast_to(numbers, (stop - start, *self.arrays["images"].shape))}


def test_a_town_is_a_source_of_places(tmp_path, monkeypatch):
    monkeypatch.setattr(TownSeasonsPlan, "render", painted)
    dataset = TownSeasons(roots=[tmp_path], **TOWN)
    source, told = as_place_source(dataset), []
    source.showing = lambda: nullcontext(lambda done, total: told.append((done, total)))
    assert source.files("train") == []
    assert source.conditions("train") == ("summer_noon", "winter_noon")
    assert not any(tmp_path.iterdir())  # nothing is rendered before it is read
    images = source.read("train")
    assert (told[0], told[-1]) == ((0, 22), (22, 22))  # all splits at once
    assert images.images.shape == (12, 16, 24, 3)
    assert images.conditions == ("summer_noon", "winter_noon")
    assert source.fingerprint() == dataset.plan().digest

    store = open_store(dataset.plan(), tmp_path)
    rows = np.flatnonzero(store.columns["split"] == 0)
    assert np.array_equal(images.images[:][:, 0, 0, 0], rows)
    assert np.array_equal(images.images[:], store.read("images", rows))
    assert np.array_equal(images.position_m, store.columns["pose"][rows, :2])
    assert np.allclose(np.radians(images.heading_deg), store.columns["pose"][rows, 3])

    summer, winter = images.rows_of("summer_noon"), images.rows_of("winter_noon")
    for tolerance in (PlaceTolerance("m", 2, 25, 30), PlaceTolerance("frames", 0, 5)):
        assert np.array_equal(images.positives(winter, summer, tolerance).toarray(), np.eye(6, dtype=bool))
    assert rendered_place_source(ConditionSplitSource(source, ConditionSplit())) is source


def test_a_split_without_frames_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(TownSeasonsPlan, "render", painted)
    source = as_place_source(TownSeasons(roots=[tmp_path], **TOWN | {"frames": {"train": 2, "val": 2, "test": 2}}))
    monkeypatch.setattr(TownSeasonsPlan, "splits", ("train", "elsewhere", "test", "val"))
    with pytest.raises(UserError, match=r"dataset=town_seasons has no val images\nframes.val=300"):
        source.read("val")


def test_what_has_no_places_is_refused(tmp_path):
    for dataset in (Digits(28), object()):
        with pytest.raises(UserError, match="Choose town_seasons"):
            as_place_source(dataset)
    office = object.__new__(OfficeWalk)
    with pytest.raises(UserError, match="dataset=office_walk has no places"):
        as_place_source(office)


@pytest.mark.parametrize(
    "overrides",
    [["dataset=nordland"], ["dataset=nordland", "dataset.frames.test=[1650,null]"],
     ["dataset=place_folders", "dataset.folder=mine"],
     ["dataset=place_folders", "dataset.folder=mine", "dataset.train={a: x, b: y}", "dataset.places=utm"]],
)  # fmt: skip
def test_configs_are_valid(overrides):
    validate(to_plain(compose(overrides)))


@pytest.mark.parametrize(
    "overrides",
    [["dataset=nordland", "dataset.frames.test=[1650]"], ["dataset=nordland", "dataset.channels=2"],
     ["dataset=place_folders", "dataset.folder=mine", "dataset.places=imu"]],
)  # fmt: skip
def test_configs_with_mistakes_are_refused(overrides):
    with pytest.raises(UserError):
        validate(to_plain(compose(overrides)))
