"""The statistics on rendered drives: all is recalled if nothing changes, chance if the labels are shuffled."""

import numpy as np
import pytest
from scipy import stats

from benchmarks.traverse_statistics import place_statistics
from sextant.composing.compose import compose, to_plain
from sextant.data.rendered import open_store
from sextant.data.worlds import TownSeasons

PLACES = 200
SMALL = {"dimensions": 32, "height": 16, "width": 32}
CONDITIONS = [
    {"name": "summer", "condition": "summer_noon"},
    {"name": "summer_again", "condition": "summer_noon"},
    {"name": "winter", "condition": "winter_noon"},
]


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    """Summer driven twice by a car that does not wander, and winter: (3, places, 32, 64, 3)."""
    cache = tmp_path_factory.mktemp("cache")
    config = to_plain(compose(["dataset=town_seasons"]))["dataset"]
    config.pop("_target_")
    config |= {"frames": {"train": PLACES, "val": 1, "test": 1}, "conditions": CONDITIONS, "step_m": 6.0, "seed": 5}
    config |= {"width": 64, "height": 32, "samples": 1, "lateral_sigma_m": 0.0, "heading_sigma_deg": 0.0}
    store = open_store(TownSeasons(roots=[cache], **config).plan(), cache)
    return store.read("images", slice(0, 3 * PLACES)).reshape(3, PLACES, 32, 64, 3)


@pytest.mark.slow
def test_drives_that_differ_in_nothing_are_recalled_whole(drives):
    for again in drives[:2]:
        found = place_statistics(drives[0], again, tolerance=0, **SMALL)
        assert set(found.recall.values()) == {1.0}
        assert found.cross_condition[0] > 0.99


@pytest.mark.slow
def test_drives_under_shuffled_labels_are_recalled_by_chance(drives):
    shuffled = np.random.default_rng(0).permutation(PLACES)
    low, high = stats.binom.interval(0.9999, PLACES, 11 / PLACES)
    for query in drives[[0, 2]]:
        found = place_statistics(drives[0], query[shuffled], tolerance=5, **SMALL)
        assert all(low <= PLACES * recall <= high for recall in found.recall.values())
        assert abs(found.cross_condition[0]) < 0.08


@pytest.mark.slow
def test_a_change_of_season_is_between_the_two(drives):
    found = place_statistics(drives[0], drives[2], tolerance=0, **SMALL)
    assert all(5 / PLACES < recall < 1 for recall in found.recall.values())
    assert 0.1 < found.cross_condition[0] < 0.9
