"""A rendered city as places: its map, and the drives through it."""

import numpy as np
import pytest

from sextant.chapters.places.data import PlaceTolerance, as_place_source
from sextant.data.rendered import open_store
from sextant.data.worlds import TownCity
from sextant.data.worlds.towns import TownCityPlan
from sextant.errors import UserError

CITY = {
    "images": 6400, "headings": 8, "size_m": 700.0, "block_m": 80.0, "width": 8, "height": 6, "vfov_deg": 55.0,
    "samples": 1, "conditions": ["summer_noon", "night_clear"], "query_frames": 800, "query_step_m": 8.0, "seed": 3,
}  # fmt: skip
NAMES = ("map", "summer_noon", "night_clear")


def numbered(self, start, stop):
    """In place of the renderer, which its own tests look at: pictures that tell their number."""
    numbers = np.arange(start, stop)[:, None, None, None] // [256, 1, 1] % 256
    return {"images": np.broadcast_to(numbers.astype(np.uint8), (stop - start, *self.arrays["images"].shape))}


@pytest.fixture
def city(tmp_path, monkeypatch):
    monkeypatch.setattr(TownCityPlan, "render", numbered)
    return TownCity(roots=[tmp_path], **CITY)


def test_the_splits_of_a_city_are_parts_of_it_with_map_and_drives(city, tmp_path):
    source = as_place_source(city)
    assert source.conditions("val") == NAMES
    assert not any(tmp_path.iterdir())  # nothing is rendered before it is read
    parts = [source.read(split) for split in ("train", "val", "test")]
    store = open_store(city.plan(), tmp_path)
    for part in parts:
        pixels = part.images[:].astype(int)[:, 0, 0]
        rows = pixels[:, 0] * 256 + pixels[:, 1]
        assert len(set(rows)) == len(rows)
        assert np.array_equal(part.position_m, store.columns["pose"][rows, :2])
        assert np.allclose(np.radians(part.heading_deg), store.columns["pose"][rows, 3])
        driven = store.columns["split"][rows] == 1
        assert np.array_equal(part.traverse, np.where(driven, 1 + store.columns["condition"][rows], 0))
        assert set(part.traverse) == {0, 1, 2}
        assert not part.drives
    west, middle, east = (part.position_m[:, 0] for part in parts)
    assert middle.min() - west.max() >= 40
    assert east.min() - middle.max() >= 40


def test_an_image_of_a_drive_has_a_place_in_the_map_seen_from_elsewhere(city):
    train = as_place_source(city).read("train")
    drive, mapped = train.rows_of("night_clear"), train.rows_of("map")
    found = train.positives(drive, mapped, PlaceTolerance("m", 8.0, 25.0, 23.0)).tocoo()
    assert np.mean(np.isin(np.arange(len(drive)), found.row)) > 0.8
    apart = np.linalg.norm(train.position_m[drive[found.row]] - train.position_m[mapped[found.col]], axis=1)
    assert apart.min() < 2
    assert apart.max() > 5


def test_a_split_that_no_drive_reaches_is_told_before_rendering(city, tmp_path):
    source = as_place_source(TownCity(roots=[tmp_path], **CITY | {"query_frames": 3}))
    with pytest.raises(UserError, match=r"lies in the (train|val|test) part of this city") as told:
        source.read("train")
    assert not any(tmp_path.iterdir())
    advice = dict(pair.split("=") for pair in str(told.value).split("example ")[1].split())
    wider = CITY | {name: float(value) if "." in value else int(value) for name, value in advice.items()}
    for seed in range(3):
        assert len(as_place_source(TownCity(roots=[tmp_path], **wider | {"seed": seed})).read("val"))


def test_no_condition_may_be_called_as_the_map(city):
    named = {"name": "map", "condition": "winter_noon"}
    source = as_place_source(TownCity(roots=[city.cache], **CITY | {"conditions": ["summer_noon", named]}))
    with pytest.raises(UserError, match="the name 'map' is reserved for the city's map"):
        source.read("train")
