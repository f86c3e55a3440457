"""Datasets of towns: what is where, which splits share nothing, and the same bytes however they are made."""

import copy
import json
import pickle
import time

import numpy as np
import pytest

from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.data.rendered import open_store
from sextant.data.worlds import TownCity, TownPanoramas, TownSeasons
from sextant.data.worlds.shots import camera_poses
from sextant.data.worlds.towns import town_seed
from sextant.errors import UserError
from sextant.worlds.scene import Scene
from sextant.worlds.surfaces import KIND, Kind

SMALL = {
    TownPanoramas: {
        "images": {"train": 11, "val": 3, "test": 4}, "towns": {"train": 3, "val": 1, "test": 2}, "height": 16,
        "samples": 1, "conditions": ["summer_noon", "winter_noon"], "size_m": 240.0, "block_m": 80.0, "seed": 3,
    },
    TownSeasons: {
        "frames": {"train": 40, "val": 12, "test": 20}, "step_m": 3.0, "lateral_sigma_m": 0.3, "heading_sigma_deg": 2.0,
        "width": 24, "height": 16, "vfov_deg": 55.0, "samples": 1,
        "conditions": ["summer_noon", "winter_dusk", "night_clear"], "block_m": 70.0,
        "trajectories": {"train": None, "val": None, "test": None}, "seed": 3,
    },
    TownCity: {
        "images": 150, "headings": 8, "size_m": 320.0, "block_m": 80.0, "width": 24, "height": 16, "vfov_deg": 55.0,
        "samples": 1, "conditions": ["summer_noon", "night_clear"], "query_frames": 25, "query_step_m": 2.0, "seed": 3,
    },
}  # fmt: skip
DATASETS = list(SMALL)


def plan_of(kind, **changes):
    return kind(roots=["/nowhere"], **(copy.deepcopy(SMALL[kind]) | changes)).plan()


@pytest.fixture(scope="module")
def plans():
    made = {kind: plan_of(kind) for kind in DATASETS}
    for plan in made.values():
        plan.detail = "coarse"
    return made


# -- all datasets ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", DATASETS)
def test_columns_describe_every_picture(plans, kind):
    plan = plans[kind]
    columns = plan.columns
    assert set(columns) == {"pose", "split", "condition", "scene", "place"}
    assert all(len(column) == plan.count for column in columns.values())
    assert columns["pose"].shape == (plan.count, 6)
    assert np.isfinite(columns["pose"]).all()
    assert np.abs(columns["pose"][:, 3]).max() <= np.pi + 1e-9
    assert (columns["pose"][:, 4:] == 0).all()  # upright
    assert plan.facts["splits"] == {
        name: int((columns["split"] == number).sum()) for number, name in enumerate(plan.splits)
    }
    assert sum(plan.facts["splits"].values()) == plan.count
    assert set(np.unique(columns["condition"])) == set(range(len(plan.condition_names)))
    assert plan.facts["conditions"] == SMALL[kind]["conditions"]
    assert plan.facts["street_kilometres"] > 0.3
    json.dumps(dict(plan.facts))


@pytest.mark.parametrize("kind", DATASETS)
def test_a_plan_is_a_function_of_its_config(plans, kind):
    same, other, colder = (
        plan_of(kind),
        plan_of(kind, seed=4),
        plan_of(kind, conditions=["winter_noon", "fog", "night_rain"]),
    )
    assert same.digest == plans[kind].digest
    for name, column in plans[kind].columns.items():
        assert np.array_equal(column, same.columns[name])
    assert len({plans[kind].digest, other.digest, colder.digest}) == 3
    assert not np.array_equal(other.columns["pose"], same.columns["pose"])


@pytest.mark.slow
@pytest.mark.parametrize("kind", DATASETS)
def test_pictures_are_the_same_alone_in_a_batch_and_after_pickling(kind):
    light = ["summer_noon", "night_clear", "summer_evening"]  # of one geometry: few worlds to build
    plan = plan_of(kind, conditions=light)
    plan.detail = "coarse"
    stop = 5
    together = plan.render(0, stop)["images"]
    height, width, _ = plan.arrays["images"].shape
    assert together.shape == (stop, height, width, 3)
    assert together.dtype == np.uint8
    assert together.std(axis=(1, 2, 3)).min() > 4
    copied = pickle.loads(pickle.dumps(plan))
    assert copied.digest == plan.digest
    for i in (stop - 1, stop - 2):
        assert np.array_equal(copied.render(i, i + 1)["images"][0], together[i])
    assert len(np.unique(together.reshape(stop, -1), axis=0)) == stop
    if kind is TownCity:
        assert not np.array_equal(plan_of(kind, seed=5).render(0, 1)["images"][0], together[0])


@pytest.mark.slow
@pytest.mark.parametrize("kind", DATASETS)
def test_cameras_stand_outside_and_a_step_from_everything_solid(kind):
    plan = plan_of(kind)
    plan.detail = "coarse"
    shots = plan.shots
    around = np.arange(128) + 0.5
    z, turn = 1 - around / 64, np.pi * (1 + 5**0.5) * around
    ways = np.column_stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
    for scene in np.unique(shots.scene)[:3]:
        eyes = np.unique(shots.pose[shots.scene == scene, :3], axis=0)
        town = plan.town(int(scene))
        for look in plan.appearances[: 2 if scene == 0 else 1]:
            world = Scene(town.mesh(look))
            assert not world.inside(eyes).any()
            origins, directions = np.repeat(eyes, 128, 0), np.tile(ways, (len(eyes), 1))
            distance, hit = world.distance(origins, directions), world.hit(origins, directions)
            leaves = np.isin(world.surfaces[world.surface[hit], KIND], [Kind.LEAVES, Kind.CONIFER])
            assert distance[~leaves].min() > 0.3
        assert 1.3 < eyes[:, 2].min() <= eyes[:, 2].max() < 2.0


@pytest.mark.slow
def test_a_store_fills_in_pieces_to_the_same_bytes(tmp_path, plans):
    plan = plan_of(TownCity, images=40, query_frames=6)
    type(plan).chunk, before = 16, type(plan).chunk
    try:
        whole, pieces = (
            open_store(plan_of(TownCity, images=40, query_frames=6), tmp_path / name) for name in ("a", "b")
        )
        assert whole.fill(threads=2) == plan.count == 52
        pieces.read("images", 50)
        pieces.read("images", 20)
        assert 0 < pieces.rendered < plan.count
        again = open_store(pickle.loads(pickle.dumps(plan)), tmp_path / "b")
        assert again.fill() == plan.count - pieces.manifest.chunk - 4
        assert np.array_equal(whole.read("images", slice(None)), again.read("images", slice(None)))
        assert whole.facts["splits"] == {"map": 40, "query": 12}
        assert np.array_equal(whole.columns["pose"], plan.columns["pose"])
    finally:
        type(plan).chunk = before


# -- panoramas ---------------------------------------------------------------------------------------------------------


def test_splits_of_panoramas_share_no_town_no_seed_and_no_place(plans):
    columns = plans[TownPanoramas].columns
    by_split = [set(columns["scene"][columns["split"] == split].tolist()) for split in range(3)]
    assert [len(scenes) for scenes in by_split] == [3, 1, 2]
    assert len(set.union(*by_split)) == 6
    seeds = {town_seed(3, scene) for scene in set.union(*by_split)}
    assert len(seeds) == 6
    assert len(np.unique(columns["place"])) == len(columns["place"])
    graphs = [plans[TownPanoramas].graph(scene).nodes.tobytes() for scene in range(6)]
    assert len(set(graphs)) == 6
    per_town = np.bincount(columns["scene"])
    assert per_town.tolist() == [3, 4, 4, 3, 2, 2]


def test_panoramas_have_light_of_their_own_and_conditions_in_equal_shares(plans):
    plan = plans[TownPanoramas]
    assert len(np.unique(plan.shots.sun_turn_deg)) == plan.count
    assert plan.shots.exposure_ev.std() == pytest.approx(0.25, rel=0.6)
    train = plan.columns["split"] == 0
    assert abs(np.mean(plan.columns["condition"][train] == 0) - 0.5) < 0.2
    _, look = plan.view_of(0)
    base = plan.appearances[plan.columns["condition"][0]]
    assert look.sun_azimuth_deg == pytest.approx((base.sun_azimuth_deg + plan.shots.sun_turn_deg[0] + 180) % 360 - 180)
    assert look.exposure_ev == pytest.approx(base.exposure_ev + plan.shots.exposure_ev[0])
    assert plan.arrays["images"].shape == (16, 32, 3)


# -- seasons -----------------------------------------------------------------------------------------------------------


def test_a_place_is_the_same_place_under_every_condition(plans):
    plan = plans[TownSeasons]
    columns = plan.columns
    for split, frames in enumerate((40, 12, 20)):
        rows = [np.flatnonzero((columns["split"] == split) & (columns["condition"] == k)) for k in range(3)]
        assert [len(row) for row in rows] == [frames] * 3
        for row in rows:
            assert columns["place"][row].tolist() == list(range(frames))
            assert (columns["scene"][row] == split).all()
        a, b, c = (columns["pose"][row] for row in rows)
        for other in (b, c):
            apart = np.linalg.norm(a[:, :2] - other[:, :2], axis=1)
            assert 0 < np.median(apart) < 0.7  # each wanders about the lane with a sigma of 0.3 m
            assert apart.max() < 1.8
            turn = (a[:, 3] - other[:, 3] + np.pi) % (2 * np.pi) - np.pi
            assert np.abs(turn).max() < np.radians(20)
    assert plan.facts["traverse_kilometres"] == {"train": 0.12, "val": 0.036, "test": 0.06}


def test_frames_are_a_step_apart_and_move_as_they_look(plans):
    plan = plans[TownSeasons]
    pose = plan.shots.pose[:40]
    gap = np.linalg.norm(np.diff(pose[:, :2], axis=0), axis=1)
    assert np.median(gap) == pytest.approx(3.0, rel=0.1)
    velocity = plan.shots.velocity[:40, :2]
    speed = np.linalg.norm(velocity, axis=1)
    assert 3 < speed.max() < 25
    along = np.diff(pose[:, :2], axis=0) / gap[:, None]
    agree = (velocity[:-1] * along).sum(1) / np.maximum(speed[:-1], 1e-9)
    assert np.median(agree[speed[:-1] > 1]) > 0.95


def traverse(plan, split, condition):
    columns = plan.columns
    return columns["pose"][(columns["split"] == split) & (columns["condition"] == condition)]


def test_wander_is_what_the_config_says():
    calm = plan_of(TownSeasons, lateral_sigma_m=0.0, heading_sigma_deg=0.0)
    a, b = (traverse(calm, 0, k) for k in (0, 1))
    assert np.abs(a - b).max() < 0.05
    a, b = (traverse(plan_of(TownSeasons, lateral_sigma_m=0.15), 0, k) for k in (0, 1))
    apart = np.linalg.norm(a[:, :2] - b[:, :2], axis=1)
    assert 0.02 < apart.max() < 1.0


def drive_of(path, side):
    """A file of KITTI poses: a metre a frame around a square."""
    corners = side * np.array([[0, 0], [0, 1], [1, 1], [1, 0], [0, 0.0]])
    arc = np.arange(0.0, 4 * side)
    x, z = (np.interp(arc, side * np.arange(5), corners[:, k]) for k in (0, 1))
    poses = np.tile(np.eye(3, 4).ravel(), (len(arc), 1))
    poses[:, 3], poses[:, 11] = x, z
    np.savetxt(path, poses)
    return str(path)


def test_streets_may_be_traced_from_a_real_drive_whose_file_is_part_of_the_identity(tmp_path):
    files = {"train": drive_of(tmp_path / "00.txt", 120.0), "val": None, "test": None}
    plan = plan_of(TownSeasons, trajectories=files)
    assert plan.graph(0).length_m == pytest.approx(480, rel=0.15)
    free = plan_of(TownSeasons)
    assert np.array_equal(plan.graph(1).nodes, free.graph(1).nodes)
    assert plan.facts["splits"] == free.facts["splits"]
    before = plan.digest
    assert plan_of(TownSeasons, trajectories=files).digest == before != free.digest
    drive_of(tmp_path / "00.txt", 140.0)
    assert plan_of(TownSeasons, trajectories=files).digest != before
    with pytest.raises(UserError, match=r"missing\.txt"):
        _ = plan_of(TownSeasons, trajectories={**files, "test": str(tmp_path / "missing.txt")}).shots


# -- the city ----------------------------------------------------------------------------------------------------------


def test_the_map_looks_all_round_at_even_steps(plans):
    columns = plans[TownCity].columns
    assert plans[TownCity].splits == ("map", "query")
    of_map = columns["split"] == 0
    pose, place = columns["pose"][of_map], columns["place"][of_map]
    assert of_map.sum() == 150
    assert (columns["condition"][of_map] == 0).all()
    for number in range(150 // 8):
        rows = pose[place == number]
        assert len(rows) == 8
        assert np.ptp(rows[:, :3], axis=0).max() == 0
        turns = np.sort(rows[:, 3] % (2 * np.pi))
        assert np.diff(turns) == pytest.approx(np.full(7, np.pi / 4))
    queries = columns["split"] == 1
    assert np.bincount(columns["condition"][queries]).tolist() == [25, 25]
    assert (columns["place"][queries] == -1).all()
    positions = pose[::8, :2]
    gap = np.linalg.norm(columns["pose"][queries][:, None, :2] - positions, axis=-1).min(1)
    spacing = plans[TownCity].facts["street_kilometres"] * 1000 / 19
    assert np.median(gap) < spacing


def test_the_city_that_is_shipped_has_172000_pictures_over_8_square_kilometres():
    shipped = to_plain(compose(["dataset=town_city"]))["dataset"]
    start = time.perf_counter()
    plan = TownCity(roots=["/nowhere"], **{key: value for key, value in shipped.items() if key != "_target_"}).plan()
    facts = plan.facts
    assert facts["splits"]["map"] == 172_000
    assert facts["square_kilometres"] >= 8
    assert facts["street_kilometres"] > 100
    assert facts["positions"] == 21_500
    assert facts["splits"]["query"] == 1000 * len(shipped["conditions"])
    summer, autumn, night, winter = plan.appearances
    assert summer.structure == autumn.structure == night.structure  # one scene for all
    assert winter.foliage_density == 0  # but for winter, which has bare trees
    assert time.perf_counter() - start < 20


def test_the_seasons_that_are_shipped_have_all_their_frames():
    shipped = to_plain(compose(["dataset=town_seasons"]))["dataset"]
    plan = TownSeasons(roots=["/nowhere"], **{key: value for key, value in shipped.items() if key != "_target_"}).plan()
    counts = {name: shipped["frames"][name] * len(shipped["conditions"]) for name in ("train", "val", "test")}
    assert plan.facts["splits"] == counts


# -- mistakes ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("conditions", "said"),
    [
        (["monsoon"], "there is no condition 'monsoon'"),
        ([], "conditions is empty"),
        (["fog", "fog"], "conditions has a duplicate name"),
        ([{"condition": "fog", "fogg": 1.0}], "an appearance has no factor 'fogg'"),
        ([{"condition": "fog", "snow": 7}], "appearance.snow is 7; it must be a number from 0 to 1"),
        ([{"condition": "fog", "snow": "deep"}], "appearance.snow is 'deep'"),
        ([{"condition": "drizzle"}], "there is no condition 'drizzle'"),
    ],
)
@pytest.mark.parametrize("kind", DATASETS)
def test_mistakes_in_conditions_are_told_before_anything_is_built(kind, conditions, said):
    with pytest.raises(UserError) as caught:
        plan_of(kind, conditions=conditions)
    assert said in str(caught.value)


def test_conditions_may_be_named_and_changed_in_single_factors():
    plan = plan_of(
        TownSeasons, conditions=["fog", {"condition": "fog", "fog_per_m": 0.1}, {"name": "mine", "snow": 0.5}]
    )
    assert plan.condition_names == ["fog", "fog_fog_per_m", "mine"]
    assert plan.appearances[1].fog_per_m == 0.1
    assert plan.appearances[2].snow == 0.5
    assert plan.facts["conditions"] == plan.condition_names


@pytest.mark.parametrize("samples", [0, 2, 100])
def test_rays_a_pixel_are_a_square_number(samples):
    with pytest.raises(UserError, match=rf"samples.*\b{samples}\b"):
        _ = plan_of(TownCity, samples=samples).rays


@pytest.fixture(scope="module")
def composed():
    return {name: to_plain(compose([f"dataset={name}"])) for name in ("town_panoramas", "town_seasons", "town_city")}


@pytest.mark.parametrize(
    ("name", "key", "value", "said"),
    [
        ("town_panoramas", "height", 4, "dataset.height=4: must be greater than or equal to 16"),
        ("town_panoramas", "samples", 3, "dataset.samples=3"),
        ("town_panoramas", "size_m", 50, "dataset.size_m=50"),
        ("town_panoramas", "towns", {"train": 999, "val": 1, "test": 1}, "dataset.towns.train=999 is more than"),
        ("town_panoramas", "images", {"train": 0, "val": 1, "test": 1}, "dataset.images.train=0"),
        ("town_panoramas", "conditions", [], "dataset.conditions"),
        ("town_seasons", "step_m", 0, "dataset.step_m=0"),
        ("town_seasons", "vfov_deg", 179, "dataset.vfov_deg=179"),
        ("town_seasons", "width", 100_000, "dataset.width=100000"),
        ("town_seasons", "frames", {"train": -1, "val": 1, "test": 1}, "dataset.frames.train=-1"),
        ("town_seasons", "block_m", 10, "dataset.block_m=10"),
        ("town_seasons", "speling", 1, "dataset.speling: unknown key"),
        ("town_city", "images", 0, "dataset.images=0"),
        ("town_city", "headings", 0, "dataset.headings=0"),
        ("town_city", "size_m", 1e6, "dataset.size_m=1000000"),
        ("town_city", "query_frames", -1, "dataset.query_frames=-1"),
        ("town_city", "seed", -1, "dataset.seed=-1"),
    ],
)
def test_sizes_out_of_range_are_told_by_the_schema(composed, name, key, value, said):
    config = copy.deepcopy(composed[name])
    validate(config)
    config["dataset"][key] = value
    with pytest.raises(UserError) as caught:
        validate(config)
    assert said in str(caught.value)


def test_poses_become_matrices_that_look_along_their_heading():
    matrices = camera_poses(np.array([[1.0, 2, 3, 0.0, 0, 0], [0, 0, 0, np.pi / 2, 0.3, 0]]))
    assert matrices.shape == (2, 4, 4)
    assert matrices[0, :3, 2] == pytest.approx([1, 0, 0])
    assert matrices[0, :3, 3].tolist() == [1, 2, 3]
    assert matrices[1, :3, 2] == pytest.approx([0, np.cos(0.3), np.sin(0.3)])
