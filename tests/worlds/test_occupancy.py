import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds.casters import Boxes, Circle

from sextant.errors import UserError
from sextant.worlds.laser import LaserScanner, scan
from sextant.worlds.occupancy import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    OccupancyGrid,
    occupancy_from_scans,
    occupancy_from_scene,
)

ROOM = Boxes((0.0, 0.0, 8.0, 6.0), (3.03, 2.03, 4.03, 3.03))  # a room with a pillar
SCANNER = LaserScanner(720, 2 * np.pi, 20.0, 0.3, 0.0)
ROUND = np.array([[1, 1, 0], [7, 1, 1], [7, 5, 2], [1, 5, 3], [2, 3, 0], [6, 3, 0.0], [3.5, 1, 0], [3.5, 5, 0]])


def scanned(resolution=0.1):
    return occupancy_from_scans(SCANNER, ROUND, scan(SCANNER, ROOM, ROUND, np.random.default_rng(0)), resolution)


def cut(resolution=0.1, bounds=(-1.0, -1.0, 9.0, 7.0), **options):
    return occupancy_from_scene(ROOM, bounds, 0.3, resolution, **options)


@given(st.integers(0, 30), st.integers(0, 20), st.floats(0.01, 2), st.floats(-50, 50))
def test_the_centre_of_a_cell_is_in_it(row, column, resolution, origin):
    grid = OccupancyGrid(np.zeros((31, 21), np.uint8), resolution, (origin, -origin))
    cell = np.array([row, column])
    assert np.array_equal(grid.world_to_cell(grid.cell_to_world(cell)), cell)
    assert grid.contains(cell)


def test_x_goes_along_columns_and_outside_is_unknown():
    grid = OccupancyGrid(np.array([[0, 1], [0, 2]], np.uint8), 1.0, (10.0, 20.0))
    points = np.array([[10.5, 20.5], [11.5, 20.5], [11.5, 21.5], [9.9, 20.5], [10.5, 22.1]])
    assert grid.state_at(points).tolist() == [FREE, OCCUPIED, UNKNOWN, UNKNOWN, UNKNOWN]


def test_both_makers_find_the_walls():
    for grid in (scanned(), cut()):
        walls = grid.cell_to_world(np.argwhere(grid.cells == OCCUPIED))
        x, y = walls.T
        outer = np.minimum.reduce([np.abs(x), np.abs(x - 8), np.abs(y), np.abs(y - 6)])
        pillar = np.maximum(np.abs(x - 3.53), np.abs(y - 2.53)) - 0.5
        assert np.minimum(outer, np.abs(pillar)).max() <= 0.1001
        for wall in ([0, 3], [8, 3], [4, 0], [4, 6], [3.03, 2.5], [3.5, 3.03]):
            assert np.linalg.norm(walls - wall, axis=1).min() < 0.12, wall


def test_a_scanned_grid_is_free_in_the_room_and_unknown_where_no_beam_went():
    grid = scanned()
    assert np.all(grid.state_at(ROUND[:, :2]) == FREE)
    assert grid.state_at(np.array([[3.5, 2.5]])) == UNKNOWN  # inside the pillar
    inside = grid.cell_to_world(np.argwhere(grid.cells == UNKNOWN))
    in_room = (inside > 0.2).all(axis=1) & (inside < [7.8, 5.8]).all(axis=1)
    assert np.abs(inside[in_room] - 2.5 - [1.03, 0.03]).max() < 0.5


def test_a_cut_scene_knows_what_can_be_reached():
    assert cut().state_at(np.array([[3.5, 2.5], [-0.5, 3.0], [1, 1]])).tolist() == [FREE, FREE, FREE]
    reached = cut(reachable_from=ROUND[:, :2])
    assert reached.state_at(np.array([[3.5, 2.5], [-0.5, 3.0], [1, 1]])).tolist() == [UNKNOWN, UNKNOWN, FREE]


def test_an_outline_askew_to_the_grid_has_no_gap():
    grid = occupancy_from_scene(Circle(3.0), (-4.0, -4.0, 4.0, 4.0), 0.3, 0.05, reachable_from=np.zeros((1, 2)))
    known = np.linalg.norm(grid.cell_to_world(np.argwhere(grid.cells == FREE)), axis=1)
    assert known.max() < 3.05
    assert len(known) * 0.05**2 == pytest.approx(np.pi * 9, rel=0.03)


def test_a_beam_without_return_marks_no_wall():
    scanner = LaserScanner(36, 2 * np.pi, 3.0, 0.3, 0.0)
    pose = np.array([[0.0, 0.0, 0.0]])
    grid = occupancy_from_scans(scanner, pose, scan(scanner, Circle(9), pose, np.random.default_rng(0)), 0.1)
    assert not (grid.cells == OCCUPIED).any()
    assert grid.state_at(np.array([[2.5, 0.0]])) == FREE


def test_distances_are_those_to_the_nearest_wall():
    cells = np.zeros((5, 7), np.uint8)
    cells[2, 3] = OCCUPIED
    distance = OccupancyGrid(cells, 0.5, (0.0, 0.0)).distance_m()
    row, column = np.indices(cells.shape)
    assert np.allclose(distance, 0.5 * np.hypot(row - 2, column - 3))
    assert np.isinf(OccupancyGrid(np.zeros((2, 2), np.uint8), 1.0, (0.0, 0.0)).distance_m()).all()


def test_a_grid_survives_its_file(tmp_path):
    grid = scanned()
    grid.save(tmp_path / "map.npz")
    read = OccupancyGrid.load(tmp_path / "map.npz")
    assert np.array_equal(read.cells, grid.cells)
    assert (read.resolution_m, read.origin) == (grid.resolution_m, grid.origin)


def test_a_file_that_is_no_grid_is_told(tmp_path):
    (tmp_path / "text.npz").write_text("no")
    np.savez(tmp_path / "other.npz", cells=np.zeros((2, 2)))
    np.savez(tmp_path / "objects.npz", cells=np.array([{}]), resolution_m=1, origin=[0, 0])
    np.savez(tmp_path / "states.npz", cells=np.full((2, 2), 7, np.uint8), resolution_m=1.0, origin=[0.0, 0.0])
    (tmp_path / "empty.npz").write_bytes(b"")
    for name in ("text", "other", "objects", "states", "empty", "absent"):
        with pytest.raises(UserError, match="not an occupancy grid"):
            OccupancyGrid.load(tmp_path / f"{name}.npz")


@pytest.mark.parametrize(
    ("resolution", "bounds"),
    [
        (0, (0.0, 0.0, 1.0, 1.0)),
        (0.1, (0.0, 0.0, 0.0, 1.0)),
        (float("nan"), (0.0, 0.0, 1.0, 1.0)),
        (1e-4, (0.0, 0.0, 9e3, 9e3)),
    ],
)
def test_an_impossible_grid_is_told(resolution, bounds):
    with pytest.raises(UserError, match=r"^resolution_m"):
        cut(resolution, bounds)
