import numpy as np
import pytest
import shapely
from worlds.handmade import by_kind, small_town

from sextant.worlds.blocks import KERB_M, PAVEMENT_M, Ground
from sextant.worlds.scene import MISS, Scene
from sextant.worlds.street_graph import StreetGraph
from sextant.worlds.street_layouts import grid_streets
from sextant.worlds.surfaces import KIND, Kind

GROUND = small_town().ground
MESH = GROUND.mesh([True] * len(GROUND.blocks))


def straight_down(points):
    return np.column_stack([points, np.full(len(points), 50.0)]), np.tile([0, 0, -1.0], (len(points), 1))


def test_blocks_and_roads_share_out_the_land():
    blocks = shapely.union_all(GROUND.blocks)
    assert sum(block.area for block in GROUND.blocks) == pytest.approx(blocks.area, rel=1e-6)
    assert blocks.intersection(GROUND.roads).area < 0.01 * GROUND.roads.area
    assert GROUND.blocks[-1].area == max(block.area for block in GROUND.blocks)
    for block, lot in zip(GROUND.blocks, GROUND.lots, strict=True):
        assert lot.within(block)
        assert lot.distance(GROUND.roads) > PAVEMENT_M - 0.1


@pytest.mark.parametrize("inset", [0.0, -PAVEMENT_M + 0.8])
def test_the_lot_lies_to_the_left_of_its_sides(inset):
    found = 0
    for number, lot in enumerate(GROUND.lots):
        line = lot.buffer(-inset, quad_segs=2)
        for side in GROUND.sides(number, inset=inset):
            assert side.length >= 6
            assert np.linalg.norm(side.along) == pytest.approx(1)
            assert line.buffer(0.95).contains(shapely.Point(side.at(side.length / 2, 0.0)))
            assert line.contains(shapely.Point(side.at(side.length / 2, 1.5)))
            assert not line.contains(shapely.Point(side.at(side.length / 2, -1.5)))
            assert side.at(side.length, 0.0) == pytest.approx(side.end)
            found += 1
    assert found > 12


def test_ground_is_everywhere_and_no_higher_than_a_kerb():
    scene = Scene(MESH)
    left, bottom, right, top = small_town().graph.bounds
    rng = np.random.default_rng(0)
    near = rng.uniform((left - 30, bottom - 30), (right + 30, top + 30), (40_000, 2))
    far = rng.uniform((left - 5000, bottom - 5000), (right + 5000, top + 5000), (4_000, 2))
    for points in (near, far):
        origins, ways = straight_down(points)
        height = 50 - scene.distance(origins, ways)
        assert (scene.hit(origins, ways) != MISS).all()
        assert height.min() >= 0
        assert height.max() <= KERB_M + 1e-6
    origins, ways = straight_down(near)
    height = 50 - scene.distance(origins, ways)
    road = shapely.contains_xy(GROUND.roads.buffer(-0.1), near[:, 0], near[:, 1])
    away = ~shapely.contains_xy(GROUND.roads.buffer(0.1), near[:, 0], near[:, 1])
    assert road.mean() > 0.1
    assert height[road].max() < 0.02
    assert height[away].min() > 0.11


def test_what_lies_above_another_lies_clearly_above():
    """Level surfaces that overlap differ in height: none flickers through the other."""
    for graph in (small_town().graph, grid_streets(3, 2, 60.0), bent_street()):
        mesh = Ground(graph).mesh([False] * 50)
        corners = mesh.triangles.astype(float)
        level = np.flatnonzero(np.ptp(corners[..., 2], axis=1) == 0)
        level = level[shapely.area(shapely.polygons(corners[level][..., :2])) > 1e-4]
        shapes = shapely.buffer(shapely.polygons(corners[level][..., :2]), -0.002)
        a, b = shapely.STRtree(shapes).query(shapes, predicate="intersects")
        pairs = a < b
        heights = corners[level][:, 0, 2]
        same = np.abs(heights[a[pairs]] - heights[b[pairs]]) < 1e-3
        overlap = shapely.area(shapely.intersection(shapes[a[pairs][same]], shapes[b[pairs][same]]))
        assert len(overlap) == 0 or overlap.max() < 1e-3


def bent_street():
    nodes = np.array([[0.0, 0], [60, 10], [100, 60], [180, 70], [100, 140]])
    return StreetGraph(nodes, np.array([[0, 1], [1, 2], [2, 3], [2, 4], [4, 0]]), np.array([8.0, 8, 12, 8, 8]))


def test_streets_carry_their_own_strips_and_markings_leave_the_crossings_free():
    graph = small_town().graph
    rows = MESH.surfaces[MESH.surfaces[:, KIND] == Kind.ROAD]
    strips = rows[rows[:, 15 - 2] < 9e3]
    assert len(strips) == len(graph.edges)
    assert sorted(strips[:, 14].tolist()) == pytest.approx(sorted((graph.widths / 2).tolist()))
    assert by_kind(MESH)["ROAD"] == 2 + 2 * len(graph.edges)


def test_green_lots_are_lawns():
    paved = by_kind(GROUND.mesh([False] * len(GROUND.blocks)))
    assert "GRASS" not in paved
    assert by_kind(MESH)["GRASS"] > 0
    assert {"PAVEMENT", "KERB", "FIELD", "ROAD"} <= set(paved)
