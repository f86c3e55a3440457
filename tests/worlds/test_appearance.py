"""Each factor does what it says, alone, and can be measured."""

import pickle
from dataclasses import fields, replace

import numpy as np
import pytest
from worlds.handmade import by_kind, pinhole, pose, renderer, small_town, town_poses, town_renderer

from sextant.errors import UserError
from sextant.worlds.appearance import CONDITIONS, RANGES, Appearance, condition, with_factors
from sextant.worlds.mesh import instances, quads
from sextant.worlds.surfaces import BLUE, KIND, RED, SEED, Kind, X, Z, surface_rows

RAYS = pinhole(64, 44, 75, 1)
POSES = town_poses(4)


def kinds_of(view, drawer):
    """Kind of surface that each pixel shows, -1 in the sky."""
    return np.where(view.surface < 0, -1, drawer.scene.surfaces[view.surface, KIND])


def views(look):
    drawer = town_renderer(look)
    return [(view, kinds_of(view, drawer)) for view in (drawer.view(RAYS, pose, look) for pose in POSES)]


# -- names and ranges --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(RANGES))
def test_a_factor_out_of_range_is_told_with_its_name_value_and_range(name):
    low, high = RANGES[name]
    for value in (low - 1, high + 1, float("nan"), float("inf"), "much", None):
        with pytest.raises(UserError) as caught:
            Appearance(**{name: value})
        assert f"appearance.{name} is {value!r}" in caught.value.problem
        assert f"from {low:g} to {high:g}" in caught.value.problem
    for value in (low, high):
        assert getattr(Appearance(**{name: value}), name) == value


def test_every_factor_has_a_range():
    assert set(RANGES) == {field.name for field in fields(Appearance)}


def test_which_things_change_is_told_by_a_whole_number():
    with pytest.raises(UserError, match=r"appearance\.change_seed is 1\.5; it must be a whole number"):
        Appearance(change_seed=1.5)
    assert Appearance(change_seed=2.0) == Appearance(change_seed=2)
    assert isinstance(Appearance(change_seed=2.0).change_seed, int)


def test_an_unknown_condition_or_factor_lists_what_there_is():
    with pytest.raises(UserError) as caught:
        condition("monsoon")
    assert "'monsoon'" in caught.value.problem
    assert all(name in caught.value.fix for name in CONDITIONS)
    with pytest.raises(UserError) as caught:
        condition("fog", fogg=1)
    assert "'fogg'" in caught.value.problem
    assert all(name in caught.value.fix for name in RANGES)
    with pytest.raises(UserError, match=r"appearance\.snow is 3"):
        with_factors(Appearance(), {"snow": 3})


def test_a_condition_with_a_factor_differs_in_that_factor_alone():
    assert condition("fog", snow=0.5) == replace(CONDITIONS["fog"], snow=0.5)
    assert condition("fog") == CONDITIONS["fog"]
    assert pickle.loads(pickle.dumps(CONDITIONS)) == CONDITIONS


def test_light_and_weather_share_a_scene_and_seasons_do_not():
    base = Appearance()
    for name, value in (("night", 1.0), ("snow", 0.5), ("exposure_ev", 1.0), ("fog_per_m", 0.1)):
        assert replace(base, **{name: value}).structure == base.structure
    for name in ("foliage_density", "facades_changed", "cars_moved", "traffic_per_100m", "change_seed"):
        assert replace(base, **{name: 1 - getattr(base, name)}).structure != base.structure


# -- what is seen ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(CONDITIONS))
def test_every_condition_shows_something(name):
    look = CONDITIONS[name]
    drawer = town_renderer(look)
    pictures = drawer.pictures(RAYS, POSES, look).astype(float)
    assert all(np.isfinite(drawer.view(RAYS, pose, look).radiance).all() for pose in POSES[:2])
    assert 12 < pictures.mean() < 235
    assert pictures.std() > 10
    assert (pictures > 250).all(-1).mean() < 0.2
    assert (pictures < 3).all(-1).mean() < 0.3


@pytest.mark.slow
def test_conditions_look_different():
    pictures = {
        name: town_renderer(look).pictures(RAYS, POSES[:2], look).astype(float) for name, look in CONDITIONS.items()
    }
    names = list(pictures)
    for i, a in enumerate(names):
        for b in names[:i]:
            assert np.abs(pictures[a] - pictures[b]).mean() > 6, (a, b)


def test_bare_trees_have_no_leaves_and_others_their_share():
    counts = {share: by_kind(small_town().mesh(Appearance(foliage_density=share))) for share in (0.0, 0.5, 1.0)}
    assert "LEAVES" not in counts[0.0]
    assert counts[0.5]["LEAVES"] == pytest.approx(counts[1.0]["LEAVES"] / 2, rel=0.02)
    for name in ("BARK", "CONIFER", "FACADE", "CAR", "ROAD"):
        assert counts[0.0][name] == counts[1.0][name]


def test_autumn_turns_the_leaves_from_green_to_red():
    warmth = {}
    for autumn in (0.0, 0.5, 1.0):
        colours = [
            view.radiance[kinds == Kind.LEAVES]
            for view, kinds in views(Appearance(foliage_autumn=autumn, cloud_cover=1.0))
        ]
        r, g, _ = np.concatenate(colours).mean(0)
        warmth[autumn] = r / g
    assert warmth[0.0] < 1.0 < warmth[1.0]
    assert warmth[0.0] < warmth[0.5] < warmth[1.0]
    before, after = (views(Appearance(foliage_autumn=a, cloud_cover=1.0)) for a in (0.0, 1.0))
    for (view, kinds), (other, _) in zip(before, after, strict=True):
        rest = np.isin(kinds, [Kind.FACADE, Kind.ROAD, Kind.PAVEMENT, Kind.CAR, -1])
        assert np.array_equal(view.radiance[rest], other.radiance[rest])


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_facades_are_painted_anew_in_the_share_that_is_asked_for(share):
    town = small_town()
    base, other = (town.mesh(Appearance(facades_changed=s, change_seed=7)) for s in (0.0, share))
    count = len(town.buildings)
    first, second = (m.surfaces[m.surfaces[:, KIND] == Kind.FACADE][:count] for m in (base, other))
    changed = np.abs(first[:, RED : BLUE + 1] - second[:, RED : BLUE + 1]).max(1) > 1e-6
    assert changed.mean() == pytest.approx(share, abs=3 * np.sqrt(share * (1 - share) / count) + 1e-9)
    assert np.array_equal(changed, first[:, SEED] != second[:, SEED])  # new windows with the new paint
    assert np.array_equal(first[:, X : Z + 1], second[:, X : Z + 1])
    walls = [
        m.triangles[np.isin(m.surface, np.flatnonzero(m.surfaces[:, KIND] == Kind.FACADE)[:count])]
        for m in (base, other)
    ]
    assert np.array_equal(*walls)


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_parked_cars_leave_and_come(share):
    town = small_town()

    def cars(**factors):
        mesh = town.mesh(Appearance(**factors))
        rows = mesh.surfaces[mesh.surfaces[:, KIND] == Kind.CAR]
        return {tuple(row[X : Z + 1].tolist()): tuple(row.tolist()) for row in rows}

    before, after = cars(), cars(cars_moved=share, change_seed=3)
    assert len(after) == pytest.approx(len(before), rel=0.25)
    stayed = np.mean([after.get(place) == car for place, car in before.items()])
    assert stayed == pytest.approx(1 - share, abs=0.12)
    places = {tuple(place) for place in town.parking.position.astype(np.float32).tolist()}
    assert set(after) <= places
    assert cars(cars_moved=1.0, change_seed=4) != cars(cars_moved=1.0, change_seed=5)


def test_traffic_adds_people_and_cars_with_lights():
    counts = {t: by_kind(small_town().mesh(Appearance(traffic_per_100m=t))) for t in (0.0, 4.0, 16.0)}
    assert "PERSON" not in counts[0.0]
    assert counts[16.0]["PERSON"] == pytest.approx(4 * counts[4.0]["PERSON"], rel=0.5)
    assert counts[0.0]["CAR"] < counts[4.0]["CAR"] < counts[16.0]["CAR"]
    mesh = small_town().mesh(Appearance(traffic_per_100m=10))
    assert (mesh.surfaces[mesh.surfaces[:, KIND] == Kind.CAR][:, 16] == 1).sum() > 5
    people = (mesh.surfaces[:, KIND] == Kind.PERSON).sum()
    moving = (mesh.surfaces[mesh.surfaces[:, KIND] == Kind.CAR][:, 16] == 1).sum()
    expected = 0.1 * small_town().graph.length_m
    assert people + moving == pytest.approx(expected, abs=4 * np.sqrt(expected))


def facade_wall(storeys=9, bays=20):
    """A large wall of windows that faces -y, and a camera before it."""
    width, height = 3.0 * bays, 3.2 + 3.0 * (storeys - 1)
    corners = np.array([[(0, 0, 0), (width, 0, 0), (width, 0, height), (0, 0, height)]], float)
    row = surface_rows(
        Kind.FACADE,
        1,
        seed=0.3,
        colour=(0.6, 0.55, 0.5),
        parameters=(width, height, 3.2, storeys, bays, 0.0, 1.0, 0.0, 0.0, 0.0),
    )
    return renderer(instances(quads(corners).reshape(1, 2, 3, 3), row)), pose(width / 2, -45, height / 2, np.pi / 2)


def test_the_share_of_windows_with_light_is_what_was_asked_for():
    drawer, eye = facade_wall()
    rays = pinhole(240, 120, 67)
    dark, some, all_lit = (
        drawer.view(rays, eye, Appearance(sun_elevation_deg=-30, night=1.0, lit_windows=s)).radiance.sum(-1)
        for s in (0, 0.35, 1)
    )
    windows = all_lit > dark + 0.02
    assert 0.1 < windows.mean() < 0.5
    lit = some > dark + 0.02
    assert (lit <= windows).all()
    assert lit.sum() / windows.sum() == pytest.approx(0.35, abs=0.1)
    assert all_lit[windows].mean() > 5 * dark[windows].mean()


def test_night_is_dark_and_lamps_shine_in_it():
    day, night, unlit = (
        [view for view, _ in views(look)]
        for look in (
            Appearance(),
            Appearance(sun_elevation_deg=-30, night=1.0, lit_windows=0.0),
            Appearance(sun_elevation_deg=-30, night=0.0, lit_windows=0.0),
        )
    )
    for bright, lit, dark in zip(day, night, unlit, strict=True):
        solid = bright.surface >= 0
        assert lit.radiance[solid].mean() < 0.4 * bright.radiance[solid].mean()
        assert lit.radiance[solid].mean() > 2 * dark.radiance[solid].mean()


def test_snow_lies_on_streets_and_roofs_and_not_on_facades():
    bare, snowy = (views(Appearance(snow=s, cloud_cover=1.0)) for s in (0.0, 0.95))
    gain = {kind: [] for kind in (Kind.ROAD, Kind.PAVEMENT, Kind.FACADE)}
    for (before, kinds), (after, _) in zip(bare, snowy, strict=True):
        for kind, values in gain.items():
            near = (kinds == kind) & (before.distance_m < 40)
            values.append((after.radiance[near] / before.radiance[near]).mean(-1))
    median = {kind: np.median(np.concatenate(values)) for kind, values in gain.items()}
    assert median[Kind.ROAD] > 2.5
    assert median[Kind.PAVEMENT] > 1.5
    assert median[Kind.FACADE] < 1.4  # more light from below, no more


def test_wet_streets_are_darker():
    dry, wet = (views(Appearance(wetness=w, cloud_cover=1.0)) for w in (0.0, 1.0))
    ratio = []
    for (before, kinds), (after, _) in zip(dry, wet, strict=True):
        ground = np.isin(kinds, [Kind.ROAD, Kind.PAVEMENT]) & (before.distance_m < 6)
        ratio.append((after.radiance[ground] / before.radiance[ground]).mean(-1))
        walls = kinds == Kind.FACADE
        assert np.abs(after.radiance[walls] - before.radiance[walls]).mean() < 0.05
    assert np.median(np.concatenate(ratio)) < 0.9


def test_shadows_move_with_the_sun():
    looks = [Appearance(sun_azimuth_deg=a, sun_elevation_deg=40, cloud_cover=0.0) for a in (0.0, 0.0, 120.0)]
    first, again, later = ([v.radiance for v, _ in views(look)] for look in looks)
    kinds = [kinds for _, kinds in views(looks[0])]
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    moved = [
        np.abs(np.log(a[k == Kind.ROAD] / b[k == Kind.ROAD])).mean(-1) > 0.5
        for a, b, k in zip(first, later, kinds, strict=True)
    ]
    assert 0.03 < np.concatenate(moved).mean() < 0.9
