"""Datasets of a town of one's own: streets and buildings of a GeoJSON file instead of invented ones."""

import copy
from itertools import pairwise

import numpy as np
import pytest
import shapely
from data.worlds.own_towns import streets_of, write
from data.worlds.test_towns import SMALL, plan_of
from docs_commands import ROOT

from sextant.baselines import Hog
from sextant.chapters.localization.data import as_localization_source
from sextant.composing.compose import compose, to_plain
from sextant.config import digest, validate
from sextant.data.worlds import TownCity, TownPanoramas, TownSeasons
from sextant.data.worlds.geojson import load_geojson
from sextant.errors import UserError
from sextant.worlds.scene import Scene
from sextant.worlds.street_layouts import grid_streets

EXAMPLE = str(ROOT / "examples" / "own_town.geojson")
DATASETS = [TownPanoramas, TownSeasons, TownCity]


@pytest.mark.parametrize("kind", DATASETS)
def test_one_file_is_the_town_of_every_split_with_other_seeds(kind):
    plan = plan_of(kind, streets=EXAMPLE)
    town = load_geojson(EXAMPLE)
    for scene in np.unique(plan.columns["scene"]).tolist():
        assert np.array_equal(plan.graph(scene).nodes, town.streets.nodes)
        assert plan.town(scene).footprints == town.footprints
    poses = [plan.columns["pose"][plan.columns["split"] == split] for split in range(len(plan.splits))]
    assert all(not np.array_equal(a[:3], b[:3]) for a, b in pairwise(poses))
    assert plan.facts["maps"][EXAMPLE]["buildings"]["built"] == len(town.footprints)
    assert plan.facts["square_kilometres"] > 0


def test_a_file_may_be_that_of_one_split():
    mine = plan_of(TownSeasons, streets={"train": None, "val": None, "test": EXAMPLE})
    free = plan_of(TownSeasons)
    assert np.array_equal(mine.graph(0).nodes, free.graph(0).nodes)
    assert np.array_equal(mine.graph(2).nodes, load_geojson(EXAMPLE).streets.nodes)
    assert mine.town(0).footprints is None


def test_the_content_of_the_file_is_part_of_the_identity(tmp_path):
    path = write(tmp_path / "a.geojson", *streets_of(grid_streets(2, 1, 90.0)))
    first, same, free = (plan_of(TownSeasons, streets=file).digest for file in (path, path, None))
    write(tmp_path / "a.geojson", *streets_of(grid_streets(1, 2, 90.0)))
    assert first == same != free
    assert plan_of(TownSeasons, streets=path).digest != first


def test_without_footprints_houses_stand_along_the_streets(tmp_path):
    plan = plan_of(TownSeasons, streets=write(tmp_path / "a.geojson", *streets_of(grid_streets(2, 1, 90.0))))
    assert len(plan.town(0).buildings) > 20


@pytest.mark.slow
@pytest.mark.parametrize("kind", [TownPanoramas, TownSeasons])
def test_cameras_stand_outside_of_houses(kind):
    plan = plan_of(kind, streets=EXAMPLE)
    plan.detail = "coarse"
    eyes = plan.shots.pose[plan.shots.scene == 0, :3]
    town = plan.town(0)
    apart = shapely.STRtree(town.outlines).query_nearest(shapely.points(eyes[:, :2]), return_distance=True)[1]
    assert apart.min() > 0.5
    assert not Scene(town.mesh(plan.appearances[0])).inside(eyes).any()


@pytest.mark.slow
def test_places_of_the_example_are_found_again_in_winter(tmp_path):
    config = SMALL[TownSeasons] | {
        "frames": {"train": 1, "val": 1, "test": 60}, "step_m": 8.0, "width": 96, "height": 64, "streets": EXAMPLE,
        "conditions": ["summer_noon", "winter_noon"],
    }  # fmt: skip
    source = as_localization_source(TownSeasons(roots=[tmp_path], **config))
    data = source.read()
    hog = Hog()
    described = [np.asarray(hog.describe(drive.images[:])) for drive in (data.map, data.test[0])]
    nearest = np.argmax(described[1] @ described[0].T, axis=1)
    apart = np.linalg.norm(data.map.poses[nearest, :2] - data.test[0].poses[:, :2], axis=1)
    assert (apart < 10).mean() > 0.5


def test_both_a_map_and_a_trajectory_are_refused():
    trajectories = {"train": "00.txt", "val": None, "test": None}
    with pytest.raises(UserError, match=r"trajectories\.train=00\.txt and streets="):
        plan_of(TownSeasons, trajectories=trajectories, streets=EXAMPLE)
    plan_of(TownSeasons, trajectories=trajectories, streets={"train": None, "val": EXAMPLE, "test": None})


# -- configs -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "choice",
    [
        ["task=calibration"],
        ["task=place_recognition"],
        ["task=place_recognition", "dataset=town_factors"],
        ["task=localization", "dataset=town_city"],
    ],
)
def test_a_config_without_streets_is_that_of_before_there_were_any(choice):
    plain = to_plain(compose(choice))
    older = copy.deepcopy(plain)
    del older["dataset"]["streets"]
    given = to_plain(compose([*choice, "dataset.streets=my.geojson"]))
    digests = [digest(validate(config).model_dump(by_alias=True)) for config in (plain, older, given)]
    assert digests[0] == digests[1] != digests[2]


def test_a_map_by_split_can_be_written_on_the_command_line():
    given = validate(
        to_plain(compose(["task=place_recognition", "dataset.streets={train:null,val:null,test:b.geojson}"]))
    )
    assert given.dataset.streets.test == "b.geojson"


@pytest.mark.parametrize("wrong", ["3", "{test:b.geojson}", "[a.geojson]"])
def test_streets_that_are_no_file_are_refused(wrong):
    with pytest.raises(UserError, match=r"dataset\.streets"):
        validate(to_plain(compose(["task=place_recognition", f"dataset.streets={wrong}"])))
