"""The office: plans that hold the poses they were carved around, closed walls, furniture out of the way."""

import itertools

import numpy as np
import pytest
import shapely
import torch

from sextant.errors import UserError
from sextant.geometry import level_camera_pose
from sextant.worlds.appearance import Appearance, condition
from sextant.worlds.office import Office
from sextant.worlds.office_carving import plan_along
from sextant.worlds.office_layouts import procedural_plan
from sextant.worlds.office_parts import FILLS
from sextant.worlds.office_plan import RoomKind
from sextant.worlds.office_shell import shell
from sextant.worlds.renderer import Rays
from sextant.worlds.scene import MISS, Scene
from sextant.worlds.trajectories import load_cold

NIGHT = condition("night_clear")


@pytest.fixture(scope="module")
def office():
    return Office(procedural_plan((30.0, 16.0), seed=3), seed=3)


@pytest.fixture(scope="module")
def scene(office):
    return Scene(office.mesh(Appearance()))


@pytest.fixture(scope="module")
def cold(real_data):
    poses = [load_cold(real_data / "cold" / name).poses for name in ("map.json", "seq1_night1.json")]
    return poses, Office(plan_along(*poses), seed=1)


def free_points(office, count, seed, metres=0.2):
    left, bottom, right, top = office.bounds
    points = np.random.default_rng(seed).uniform((left, bottom), (right, top), (20 * count, 2))
    room = shapely.buffer(office.plan.free, -metres)
    return points[shapely.contains_xy(room, points[:, 0], points[:, 1])][:count]


def panorama(points, height, directions=48, seed=0):
    """Random rays in all directions from each point at a height."""
    way = np.random.default_rng(seed).normal(size=(len(points) * directions, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    start = np.repeat(np.column_stack([points, np.full(len(points), height)]), directions, axis=0)
    return start, way


def straight(*corners, step=0.05):
    """A drive from corner to corner."""
    pieces = []
    for a, b in itertools.pairwise(corners):
        n = max(2, int(np.hypot(b[0] - a[0], b[1] - a[1]) / step))
        pieces.append(np.linspace(a, b, n))
    return np.concatenate(pieces)


# -- plans -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(12.0, 9.0), (30.0, 14.0), (60.0, 34.0)])
def test_rooms_of_a_procedural_plan_keep_a_wall_apart_and_hang_together(size):
    plan = procedural_plan(size, seed=5)
    boxes = [shapely.box(*room.box) for room in plan.rooms]
    for i, a in enumerate(boxes):
        for b in boxes[:i]:
            assert a.distance(b) > 0.149
    left, bottom, right, top = plan.bounds
    assert right - left == pytest.approx(size[0] + 0.7)
    assert top - bottom == pytest.approx(size[1] + 0.7)
    assert plan.walkable.area > 0.7 * plan.floor_area_m2
    assert plan.free.area + plan.walls.area == pytest.approx(plan.building.area)
    for door in plan.doors:
        for number in door.rooms:  # a doorway ends where its rooms begin
            assert shapely.box(*door.box).distance(boxes[number]) < 1e-9
    assert all(
        room.kind is RoomKind.CORRIDOR or i in {n for d in plan.doors for n in d.rooms}
        for i, room in enumerate(plan.rooms)
    )


def test_procedural_plans_depend_on_the_seed_alone():
    a, b, c = (procedural_plan((40.0, 18.0), seed) for seed in (1, 1, 2))
    assert (a.rooms, a.doors, a.windows) == (b.rooms, b.doors, b.windows)
    assert a.rooms != c.rooms


@pytest.mark.parametrize(
    ("size", "key"), [((5.0, 12.0), "width"), ((30.0, 500.0), "depth"), ((30.0, float("nan")), "depth")]
)
def test_an_impossible_size_names_key_value_range_and_fix(size, key):
    with pytest.raises(UserError, match="must be a number of metres from") as error:
        procedural_plan(size, seed=0)
    assert key in error.value.problem
    assert "size_m=[40,16]" in error.value.fix


def test_poses_in_walls_and_outside_are_named(office):
    plan = office.plan
    room = plan.rooms[0].box
    good = [(room[0] + 1.0, (room[1] + room[3]) / 2, 0.3)]
    office.check_poses(np.array(good), clearance_m=0.3)
    wall = np.array([*good, (room[0] - 0.1, room[1] + 0.5, 0.0)])
    with pytest.raises(UserError, match=r"pose 1 at \(-0\.100, .* inside a wall; 1 of 2"):
        office.check_poses(wall)
    with pytest.raises(UserError, match=r"pose 1 .* outside the building"):
        office.check_poses(np.array([*good, (99.0, 2.0, 0.0)]))
    with pytest.raises(UserError, match="from a wall"):
        office.check_poses(np.array([(room[0] + 0.2, (room[1] + room[3]) / 2, 0.0)]), clearance_m=0.3)
    with pytest.raises(UserError, match="pose 0 is not finite"):
        office.check_poses(np.array([(np.nan, 0.0, 0.0)]))
    with pytest.raises(UserError, match="rows of x, y"):
        office.check_poses(np.zeros(3))


DRIVES = {
    "one pose": np.zeros((1, 3)),
    "an L": straight((0, 0), (14, 0.1), (14, 11)),
    "corridor and rooms": straight(
        (0, 0), (6, 0), (6, -3.5), (7, -3.5), (6.1, -2), (6.1, 0), (12, 0), (12, 4), (12, 0), (0, 0.2)
    ),
    "a ring": straight((0, 0), (12, 0), (12, 9), (0, 9), (0, 0)),
    "a cross": straight((-8, 0), (8, 0), (0, 0), (0, 9), (0, -9)),
    "a diagonal": straight((0, 0), (7, 7), (0, 3), (5, 0)),
    "a turned corridor": straight((0, 0), (9, 6), (7, 9), (9, 6), (0, 0)),
}


@pytest.mark.parametrize("name", DRIVES)
def test_a_carved_plan_holds_its_drive(name):
    plan = plan_along(DRIVES[name])
    plan.check_poses(DRIVES[name], clearance_m=0.35)
    assert not any(a.intersects(b) for i, a in enumerate(map(_box, plan.rooms)) for b in map(_box, plan.rooms[:i]))


def _box(room):
    return shapely.box(*room.box)


def test_random_walks_are_held_too():
    rng = np.random.default_rng(4)
    for _ in range(15):
        turns = rng.normal(0, 0.25, 500).cumsum()
        walk = np.column_stack([np.cos(turns), np.sin(turns)]).cumsum(axis=0) * 0.06
        plan_along(walk).check_poses(walk, clearance_m=0.35)


def test_a_corridor_is_found_where_the_drive_is_straight():
    plan = plan_along(DRIVES["corridor and rooms"])
    kinds = [room.kind for room in plan.rooms]
    assert kinds.count(RoomKind.CORRIDOR) == 1
    assert plan.rooms[0].width > 12 > 3 > plan.rooms[0].depth
    assert len(plan.rooms) > 5


def test_bad_trajectories_are_refused():
    with pytest.raises(UserError, match="needs a trajectory"):
        plan_along()
    with pytest.raises(UserError, match="rows of x, y"):
        plan_along(np.zeros((0, 3)))
    with pytest.raises(UserError, match="pose 1 is not finite"):
        plan_along(np.array([(0.0, 0.0), (np.inf, 0.0)]))
    with pytest.raises(UserError, match="spans 5000 m"):
        plan_along(np.array([(0.0, 0.0), (5000.0, 0.0)]))


# -- the office --------------------------------------------------------------------------------------------------------


def test_the_same_seed_builds_the_same_office(office):
    again = Office(procedural_plan((30.0, 16.0), seed=3), seed=3).mesh(Appearance())
    mesh = office.mesh(Appearance())
    assert np.array_equal(mesh.triangles, again.triangles)
    assert np.array_equal(mesh.surfaces, again.surfaces)
    other = Office(office.plan, seed=4).mesh(Appearance())
    assert other.triangles.shape != mesh.triangles.shape or not np.array_equal(other.triangles, mesh.triangles)


def test_each_structural_factor_changes_what_it_names(office):
    base = office.mesh(Appearance())
    posters = office.mesh(Appearance(facades_changed=1.0))
    assert np.array_equal(posters.triangles, base.triangles)
    assert not np.array_equal(posters.surfaces, base.surfaces)
    people = office.mesh(Appearance(traffic_per_100m=3.0))
    assert len(people) > len(base)
    chairs = [office.mesh(Appearance(cars_moved=0.5, change_seed=k)) for k in (1, 1, 2)]
    assert np.array_equal(chairs[0].triangles, chairs[1].triangles)
    assert chairs[0].triangles.shape != chairs[2].triangles.shape or not np.array_equal(
        chairs[0].triangles, chairs[2].triangles
    )
    assert np.array_equal(office.mesh(NIGHT).triangles, base.triangles)


@pytest.mark.parametrize("heading", [0.0, 0.7])
def test_no_ray_leaves_the_building(heading):
    plan = procedural_plan((24.0, 20.0), seed=2).moved(heading, (40.0, -7.0))
    office = Office(plan, seed=1)
    empty = Scene(shell(plan, 1, office.fills))  # in the frame of the plan
    start, way = panorama(plan.to_plan(free_points(office, 400, 1)), 1.1)
    triangle = empty.hit(start, way)
    assert (triangle != MISS).all()
    seen = empty.surfaces[empty.surface[triangle]]
    hull = np.isclose(seen[:, FILLS.start + 1], 0.9)  # what stands behind the walls, were there a gap
    assert hull.mean() < 1e-4
    facing = np.einsum("ij,ij->i", empty.normals[triangle], way) < 0
    assert facing.mean() > 0.99


def test_free_space_is_free_and_walls_are_walls(office):
    empty = Scene(shell(office.plan, 1, office.fills))
    inside = free_points(office, 200, 3, metres=0.45)
    around = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    way = np.tile(np.stack([np.cos(around), np.sin(around), 0 * around], -1), (len(inside), 1))
    start = np.repeat(np.column_stack([inside, np.full(len(inside), 1.2)]), 32, axis=0)
    meets = start + empty.distance(start, way)[:, None] * way
    off = shapely.distance(office.plan.free.boundary, shapely.points(meets[:, :2]))
    at_leaf_or_niche = off > 0.01
    assert at_leaf_or_niche.mean() < 0.35
    assert shapely.distance(office.plan.free, shapely.points(meets[:, :2])).max() < 0.4


def test_no_two_surfaces_share_a_plane(office, scene):
    start, way = panorama(free_points(office, 400, 5), 1.3)
    first = scene.distance(start, way)
    again = scene.distance(start + (first + 1e-4)[:, None] * way, way)
    assert (again < 4e-4).mean() < 5e-4


def test_furniture_leaves_doorways_open(office):
    keep = [shapely.box(*door.box) for door in office.plan.doors]
    for thing in office.furnishing.things:
        if thing.box is not None:
            body = shapely.box(*thing.box)
            assert all(body.distance(door) > 0.05 for door in keep)
            assert shapely.covers(shapely.buffer(office.plan.local_free, 1e-6), body)


def test_daylight_comes_through_windows_and_lamps_burn_at_night(office):
    along = (np.arange(48) + 0.5) / 24 - 1
    x, y = np.meshgrid(along, along / 1.5)
    bearings = np.stack([x, y, np.ones_like(x)], -1)
    bearings /= np.linalg.norm(bearings, axis=-1, keepdims=True)
    rays = Rays.of(bearings[:, :, None])
    window = office.plan.windows[0]
    room = office.plan.rooms[window.room].box
    middle = np.array([(room[0] + room[2]) / 2, (room[1] + room[3]) / 2])
    x, y = office.plan.rooms[window.room].start(window.side)
    dx, dy = ((1, 0), (0, 1), (-1, 0), (0, -1))[window.side]
    glass = np.array([x + dx * (window.start + 0.4), y + dy * (window.start + 0.4)])
    heading = float(np.arctan2(*(glass - middle)[::-1]))
    pose = level_camera_pose(*(torch.tensor(v, dtype=torch.float64) for v in (*middle, 1.5, heading))).numpy()
    renderer = office.renderer(Appearance())
    day, night = (renderer.picture(rays, pose, a).astype(float) for a in (Appearance(), NIGHT))
    assert day.min() >= 0
    assert 40 < day.mean() < 235
    assert 40 < night.mean() < 235
    assert np.abs(day - night).mean() > 8
    assert np.array_equal(day, renderer.picture(rays, pose, Appearance()))


# -- real poses --------------------------------------------------------------------------------------------------------


@pytest.mark.real_data
def test_every_cold_pose_is_on_free_floor(cold):
    poses, office = cold
    for drive in poses:
        office.check_poses(drive, clearance_m=0.35)
    assert sum(room.kind is RoomKind.CORRIDOR for room in office.plan.rooms) == 1
    assert len(office.plan.rooms) >= 8
    assert 150 < office.floor_area_m2 < 500


@pytest.mark.real_data
@pytest.mark.parametrize("appearance", [Appearance(), Appearance(cars_moved=1.0, traffic_per_100m=8.0, change_seed=5)])
def test_nothing_stands_in_the_way_of_cold(cold, appearance):
    poses, office = cold
    scene = Scene(office.mesh(appearance))
    points = np.concatenate(poses)[::3, :2]
    around = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    way = np.tile(np.stack([np.cos(around), np.sin(around), 0 * around], -1), (len(points), 1))
    for height in (0.3, 0.9):
        start = np.repeat(np.column_stack([points, np.full(len(points), height)]), 24, axis=0)
        assert scene.distance(start, way).min() > 0.2
