"""One factor at a time: what is rendered, from where, in which order, and what is refused."""

import copy
from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest

from sextant.chapters.places.data import as_place_source
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.data.worlds import TownFactors, TownSeasons
from sextant.data.worlds.town_factors import MOST_CONDITIONS, factor_conditions
from sextant.errors import UserError
from sextant.worlds.appearance import Appearance, condition

TOWNS = {
    "frames": {"train": 30, "val": 10, "test": 20}, "step_m": 3.0, "lateral_sigma_m": 0.3, "heading_sigma_deg": 2.0,
    "width": 24, "height": 16, "vfov_deg": 55.0, "samples": 1, "block_m": 70.0,
    "trajectories": {"train": None, "val": None, "test": None}, "seed": 3,
}  # fmt: skip
SMALL = TOWNS | {
    "places": {"train": 4, "test": 5}, "base": "winter_noon",
    "factors": {"cars_moved": [0.5], "fog_per_m": [0.02, 0.08], "foliage_density": [1.0], "snow": [0.0, 0.9]},
    "only": None,
}  # fmt: skip


def dataset_of(root="/nowhere", **changes):
    return TownFactors(roots=[root], **(copy.deepcopy(SMALL) | changes))


def changed(look, base):
    return {f.name: getattr(look, f.name) for f in fields(Appearance) if getattr(look, f.name) != getattr(base, f.name)}


def test_every_condition_differs_from_the_map_in_the_factor_of_its_name_alone():
    """The map's own value, snow=0.9 here, is not rendered twice."""
    plan = dataset_of().plan()
    assert plan.condition_names[:2] == ["winter_noon", "winter_noon_again"]
    assert plan.condition_names[2:] == [
        "cars_moved=0.5", "fog_per_m=0.02", "fog_per_m=0.08", "foliage_density=1", "snow=0",
    ]  # fmt: skip
    base = condition("winter_noon")
    for name, look in zip(plan.condition_names, plan.appearances, strict=True):
        factor, _, value = name.partition("=")
        assert changed(look, base) == ({factor: float(value)} if value else {})


def test_all_queries_of_a_place_are_taken_from_one_spot_on_another_drive_than_the_map():
    plan = dataset_of().plan()
    columns = plan.columns
    seasons = TownSeasons(roots=["/nowhere"], **TOWNS, conditions=["winter_noon", "fog"]).plan()

    def poses(plan, split, number):
        found = plan.columns
        return found["pose"][(found["split"] == split) & (found["condition"] == number)]

    for number in range(len(plan.condition_names)):
        assert np.array_equal(poses(plan, 2, number), poses(seasons, 2, min(number, 1))[:5])
    assert np.array_equal(poses(plan, 0, 0), poses(seasons, 0, 0)[:4])
    assert not np.array_equal(poses(plan, 2, 0), poses(plan, 2, 1))
    assert plan.facts["splits"] == {"train": 4, "val": 0, "test": 5 * 7}
    assert plan.facts["factors"] == SMALL["factors"]
    assert plan.facts["drive_kilometres"] == 0.015
    assert (columns["condition"][columns["split"] == 0] == 0).all()


def test_a_town_is_built_once_for_each_geometry():
    """Conditions of one geometry lie together, wherever they stand in the config."""
    plan = dataset_of().plan()
    test = plan.shots.condition[plan.shots.split == 2]
    structures = [plan.appearances[number].structure for number in test]
    switches = sum(a != b for a, b in pairwise(structures))
    assert switches == len(set(structures)) - 1 == 2


def test_some_of_the_factors_may_be_rendered_alone():
    plan = dataset_of(only=["snow"]).plan()
    assert plan.condition_names == ["winter_noon", "winter_noon_again", "snow=0"]
    assert plan.digest == dataset_of(factors={"snow": [0.0, 0.9]}).plan().digest
    assert plan.facts["factors"] == {"snow": [0.0, 0.9]}


def test_the_identity_knows_the_factors():
    digests = {
        dataset_of(**changes).plan().digest
        for changes in ({}, {"base": "fog"}, {"factors": {"snow": [0.0]}}, {"places": {"train": 4, "test": 6}})
    }
    assert len(digests) == 4
    assert dataset_of().plan().digest in digests


@pytest.mark.slow
def test_it_is_a_source_of_places(tmp_path):
    plan = dataset_of(tmp_path).plan()
    source = as_place_source(dataset_of(tmp_path, factors={"fog_per_m": [0.2]}))
    images = source.read("test")
    assert images.conditions == ("winter_noon", "winter_noon_again", "fog_per_m=0.2")
    assert np.bincount(images.traverse).tolist() == [5, 5, 5]
    again, fog = (images.images[images.rows_of(name)].astype(float) for name in images.conditions[1:])
    assert fog.std() < 0.7 * again.std()
    train = source.read("train")
    assert train.images.shape == (4, 16, 24, 3)
    assert source.fingerprint() != plan.digest


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"base": "monsoon"}, "there is no condition 'monsoon'"),
        ({"factors": {"fogg": [1.0]}}, "an appearance has no factor 'fogg'"),
        ({"factors": {"snow": [7.0]}}, "appearance.snow is 7.0; it must be a number from 0 to 1"),
        ({"factors": {"snow": [0.1, 0.1]}}, "factors.snow=[0.1, 0.1]: each value must occur once"),
        ({"only": ["snow", "rain"]}, "only names rain, which have no values in factors"),
        ({"places": {"train": 4, "test": 21}}, "places.test=21 is more than frames.test=20"),
    ],
)
def test_mistakes_are_told_before_anything_is_rendered(changes, said):
    with pytest.raises(UserError) as caught:
        dataset_of(**changes).plan()
    assert said in str(caught.value)


def test_a_store_numbers_conditions_in_one_byte():
    values = np.linspace(0.001, 0.5, MOST_CONDITIONS - 2).tolist()
    assert len(factor_conditions("summer_noon", {"fog_per_m": values})) == MOST_CONDITIONS
    with pytest.raises(UserError, match="125 are possible"):
        factor_conditions("summer_noon", {"fog_per_m": values, "snow": [1.0]})
    with pytest.raises(UserError, match="no values other than those of summer_noon"):
        factor_conditions("summer_noon", {"snow": [0.0]})


def test_the_dataset_that_is_shipped_is_small_and_of_the_towns_that_networks_are_trained_on():
    raw = to_plain(compose(["dataset=town_factors"]))
    validate(raw)
    shipped = {key: value for key, value in raw["dataset"].items() if key != "_target_"}
    seasons = to_plain(compose(["dataset=town_seasons"]))["dataset"]
    shared = set(shipped) & set(seasons) - {"_target_"}
    assert {key: shipped[key] for key in shared} == {key: seasons[key] for key in shared}
    plan = TownFactors(roots=["/nowhere"], **shipped).plan()
    assert plan.count < 6000
    assert (plan.camera.width, plan.camera.height) == (96, 64)
    assert all(5 <= len(values) + 1 <= 7 for values in shipped["factors"].values())
    with pytest.raises(UserError, match=r"dataset\.factors"):
        validate(raw | {"dataset": raw["dataset"] | {"factors": {}}})
