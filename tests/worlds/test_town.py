"""What stands in a town stands apart, on the ground, and out of the way of cameras."""

import numpy as np
import pytest
import shapely
from worlds.handmade import small_town, town_renderer

from sextant.errors import UserError
from sextant.worlds.appearance import Appearance
from sextant.worlds.buildings import footprints
from sextant.worlds.scene import Scene
from sextant.worlds.street_layouts import grid_streets, irregular_streets
from sextant.worlds.surfaces import KIND, Kind, X, Z
from sextant.worlds.town import LEAVES, Town

TOWNS = {
    "small": small_town,
    "dense": lambda: Town(irregular_streets(300.0, 85.0, 4), 4, detail="coarse", density=0.95),
    "village": lambda: Town(irregular_streets(380.0, 90.0, 5), 5, detail="coarse", density=0.3),
}


@pytest.fixture(scope="module", params=list(TOWNS))
def town(request):
    return TOWNS[request.param]()


def houses(town):
    return shapely.polygons(footprints(town.buildings).astype(float))


def test_houses_overlap_neither_each_other_nor_the_streets(town):
    outlines = houses(town)
    a, b = shapely.STRtree(outlines).query(outlines, predicate="intersects")
    common = shapely.intersection(outlines[a[a < b]], outlines[b[a < b]])
    depth = [2 * part.area / part.length for part in common if part.area > 0]
    assert max(depth, default=0.0) < 0.06  # walls of a terrace
    assert shapely.area(shapely.intersection(outlines, town.ground.roads)).max() == 0
    lots = shapely.union_all(town.ground.lots)
    assert shapely.area(shapely.difference(outlines, lots)).max() < 0.05
    assert len(outlines) > 40


def test_trees_posts_and_cars_keep_out_of_houses(town):
    outlines = shapely.STRtree(houses(town))
    for things, metres in (
        (town.trees, 1.5),
        (town.lamps, 0.5),
        (town.signs, 0.5),
        (town.parking, 1.0),
        (town.benches, 0.3),
    ):
        assert len(things.position) > 0
        points = shapely.points(things.position[:, :2])
        assert outlines.query_nearest(points, return_distance=True)[1].min() > metres
    for things in (town.trees, town.lamps, town.signs):
        x, y, _ = things.position.T
        assert not shapely.contains_xy(town.ground.roads, x, y).any()
    x, y, _ = town.parking.position.T
    assert not shapely.contains_xy(town.ground.roads.buffer(-0.8), x, y).any()  # at the kerb, not in the lane


def test_parked_cars_and_lamps_do_not_stand_in_each_other(town):
    along = np.stack([np.cos(town.parking.heading), np.sin(town.parking.heading)], -1)
    middle = shapely.linestrings(np.stack([town.parking.position[:, :2] + k * along for k in (-1.4, 1.4)], 1))
    cars = shapely.buffer(middle, 0.85, cap_style="square")
    posts = shapely.points(np.concatenate([town.lamps.position, town.signs.position])[:, :2])
    within, _ = shapely.STRtree(cars).query(posts, predicate="within")
    assert len(within) < 0.04 * len(posts)


def test_a_mesh_is_finite_solid_and_in_the_range_of_its_tables(town):
    mesh = town.mesh(Appearance(traffic_per_100m=3, facades_changed=0.3))
    assert np.isfinite(mesh.triangles).all()
    assert np.isfinite(mesh.surfaces).all()
    assert mesh.surface.min() >= 0
    assert mesh.surface.max() < len(mesh.surfaces)
    corners = mesh.triangles.astype(float)
    sides = np.linalg.norm(np.roll(corners, -1, 1) - corners, axis=2).max(1)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    assert (area / sides).min() > 2e-4  # metres: no slivers
    assert len(Scene(mesh)) == len(mesh)
    assert corners[..., 2].min() > -0.3
    assert corners[..., 2].max() < 60
    assert set(mesh.surfaces[:, KIND].astype(int)) <= {int(kind) for kind in Kind}


def test_a_ray_straight_down_always_lands_and_in_the_streets_on_the_ground(town):
    scene = Scene(town.mesh(Appearance()))
    left, bottom, right, top = town.graph.bounds
    points = np.random.default_rng(0).uniform((left - 200, bottom - 200), (right + 200, top + 200), (20_000, 2))
    origins = np.column_stack([points, np.full(len(points), 200.0)])
    height = 200 - scene.distance(origins, np.tile([0, 0, -1.0], (len(points), 1)))
    assert np.isfinite(height).all()
    assert height.min() >= 0
    hit = scene.hit(origins, np.tile([0, 0, -1.0], (len(points), 1)))
    ground = np.isin(
        scene.surfaces[scene.surface[hit], KIND], [Kind.ROAD, Kind.PAVEMENT, Kind.GRASS, Kind.FIELD, Kind.KERB]
    )
    assert height[ground].max() <= 0.12 + 1e-5
    street = shapely.contains_xy(town.ground.roads, points[:, 0], points[:, 1])
    assert ground[street].mean() > 0.7
    assert (height[~ground] > 0.12).all()


def test_cameras_in_the_street_are_outside_and_in_houses_inside():
    town, scene = small_town(), town_renderer(Appearance()).scene
    graph = town.graph
    rng = np.random.default_rng(0)
    a, b = graph.nodes[graph.edges[rng.integers(0, len(graph.edges), 300)]].transpose(1, 0, 2)
    points = a + rng.uniform(0.1, 0.9, (300, 1)) * (b - a)
    assert not scene.inside(np.column_stack([points, np.full(300, 1.6)])).any()
    middles = town.buildings.position.copy()
    middles[:, 2] = 1.6
    assert scene.inside(middles).mean() > 0.98


def test_things_keep_clear_of_cameras():
    graph = grid_streets(2, 2, 90.0)
    cameras = np.column_stack([np.linspace(5, 175, 120), np.full(120, 92.0)])
    look = Appearance(traffic_per_100m=15)
    busy, cleared = (Town(graph, 2, detail="coarse", keep_clear=c) for c in (None, cameras))
    eyes = np.column_stack([cameras, np.full(120, 1.0)])
    angle = np.arange(64) * 2 * np.pi / 64
    way = np.tile(np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]), (120, 1))
    nearest = [
        Scene(town.mesh(look)).distance(np.repeat(eyes, 64, 0), way).reshape(120, 64).min(1) for town in (busy, cleared)
    ]
    assert nearest[0].min() < 0.3
    assert nearest[1].min() > 0.3
    assert not Scene(cleared.mesh(look)).inside(eyes).any()
    assert np.array_equal(busy.buildings.position, cleared.buildings.position)
    assert 0.8 * len(busy.parking.rows) < len(cleared.parking.rows) <= len(busy.parking.rows)


def test_people_walk_on_pavements_and_cars_drive_on_the_right():
    town = small_town()
    mesh = town.mesh(Appearance(traffic_per_100m=20))
    people = mesh.surfaces[mesh.surfaces[:, KIND] == Kind.PERSON][:, X : Z + 1].astype(float)
    assert len(people) > 20
    assert people[:, 2] == pytest.approx(np.full(len(people), 0.12), abs=1e-6)
    on_road = shapely.contains_xy(town.ground.roads.buffer(-0.1), people[:, 0], people[:, 1])
    assert on_road.mean() < 0.1
    outlines = shapely.STRtree(houses(town))
    assert outlines.query_nearest(shapely.points(people[:, :2]), return_distance=True)[1].min() > 0


def test_detail_decides_on_triangles_and_not_on_what_stands():
    fine = Town(small_town().graph, 3, detail="fine")
    assert np.array_equal(fine.buildings.position, small_town().buildings.position)
    assert np.array_equal(fine.parking.rows, small_town().parking.rows)
    assert LEAVES["fine"] > 5 * LEAVES["coarse"]


def test_lamps_shine_where_lamps_stand():
    drawer = town_renderer(Appearance())
    assert len(drawer.lamps.position) == len(small_town().lamps.position)
    assert drawer.lamps.position[:, 2].min() > 5


def test_density_builds_up_the_middle():
    graph = irregular_streets(600.0, 85.0, 1)
    low, high = (Town(graph, 1, detail="coarse", density=d) for d in (0.2, 0.95))
    assert high.buildings.storeys.mean() > low.buildings.storeys.mean() + 1
    assert high.districts[high.districts >= 0].mean() > low.districts[low.districts >= 0].mean() + 0.3


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [("detail", "ultra", "fine, coarse"), ("density", 1.5, "from 0 to 1"), ("density", -1, "from 0 to 1")],
)
def test_an_impossible_town_is_told(key, value, said):
    with pytest.raises(UserError, match=rf"^{key} is .*{value}.*{said}"):
        Town(small_town().graph, 0, **{key: value})
