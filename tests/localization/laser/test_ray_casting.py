import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds.casters import Boxes, Circle

from sextant.localization.laser.beam_model import free_steps, ray_ranges
from sextant.worlds.laser import LaserScanner, scan
from sextant.worlds.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, occupancy_from_scans, occupancy_from_scene

FULL_TURN = LaserScanner(beams=72, field_of_view_rad=2 * np.pi, max_range_m=50, range_sigma_m=0.0)


def cast(grid, poses, angles, reach):
    return ray_ranges(grid, free_steps(grid), np.asarray(poses, float), np.asarray(angles, float), reach)


def by_slabs(grid, x, y, bearing, reach):
    """The same by clipping the ray with every cell that is not free, without walking."""
    direction = np.array([np.cos(bearing), np.sin(bearing)])
    origin = np.array([x, y])
    low = np.array(grid.origin)
    high = low + np.array(grid.cells.shape[::-1]) * grid.resolution_m

    def clip(lower, upper):
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.sort(np.stack([(lower - origin) / direction, (upper - origin) / direction]), axis=0)
        ends = np.where(np.isnan(ends), np.array([[-np.inf], [np.inf]]).reshape(2, *[1] * (ends.ndim - 1)), ends)
        return np.maximum(ends[0].max(axis=-1), 0), ends[1].min(axis=-1)

    rows, columns = np.nonzero(grid.cells != FREE)
    corner = low + np.column_stack([columns, rows]) * grid.resolution_m
    enters, leaves = clip(corner, corner + grid.resolution_m)
    met = leaves > enters
    if met.any():
        first = np.flatnonzero(met)[enters[met].argmin()]
        if enters[first] < reach:
            known = grid.cells[rows[first], columns[first]] == OCCUPIED
            return min((enters[first] + leaves[first]) / 2, reach) if known else np.nan
    return reach if clip(low, high)[1] >= reach else np.nan


@given(st.integers(0, 10_000), st.sampled_from([0.02, 0.2, 0.6]), st.sampled_from([1.5, 4.0, 30.0]))
def test_walking_cell_by_cell_finds_what_clipping_with_every_cell_does(seed, density, reach):
    rng = np.random.default_rng(seed)
    cells = rng.choice(
        np.array([FREE, OCCUPIED, UNKNOWN], np.uint8), (17, 23), p=[1 - density, density * 0.8, density * 0.2]
    )
    grid = OccupancyGrid(cells, 0.25, (-2.0, 1.0))
    poses = np.column_stack([rng.uniform(-2, 3.75, 5), rng.uniform(1, 5.25, 5), rng.uniform(-9, 9, 5)])
    angles = rng.uniform(-np.pi, np.pi, 9)
    expected = [[by_slabs(grid, x, y, heading + angle, reach) for angle in angles] for x, y, heading in poses]
    np.testing.assert_allclose(cast(grid, poses, angles, reach), expected, atol=1e-9)


@pytest.mark.parametrize("resolution", [0.05, 0.1])
def test_ranges_are_those_of_the_scene_that_the_grid_was_cut_from(resolution):
    room = Boxes((0.0, 0.0, 8.0, 5.0), (3.0, 2.0, 3.6, 2.7))
    grid = occupancy_from_scene(room, (-0.5, -0.5, 8.5, 5.5), 0.3, resolution)
    rng = np.random.default_rng(3)
    poses = np.column_stack([rng.uniform(0.5, 2.5, 20), rng.uniform(0.5, 4.5, 20), rng.uniform(-4, 4, 20)])
    truth = scan(FULL_TURN, room, poses, rng)
    found = cast(grid, poses, FULL_TURN.angles, 50.0)
    bearing = poses[:, 2:] + FULL_TURN.angles
    ends = poses[:, None, :2] + found[..., None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    from_walls = np.min([outline_distance(ends, wall) for wall in room.boxes], axis=0)
    assert from_walls.max() <= resolution  # at a grazing angle the range itself is farther off
    assert np.median(np.abs(found - truth)) < resolution


def outline_distance(points, box):
    """Distance (the larger of two coordinates) of points from the outline of a rectangle."""
    left, bottom, right, top = box
    beyond = np.stack([left - points[..., 0], points[..., 0] - right, bottom - points[..., 1], points[..., 1] - top])
    return np.abs(beyond.max(axis=0))


def test_a_grid_from_scans_predicts_them():
    scene = Circle(6.0)
    rng = np.random.default_rng(0)
    dense = LaserScanner(beams=720, field_of_view_rad=2 * np.pi, max_range_m=20, range_sigma_m=0.0)
    drive = np.column_stack([np.linspace(-3, 3, 15), np.zeros(15), np.zeros(15)])
    grid = occupancy_from_scans(dense, drive, scan(dense, scene, drive, rng), 0.1)
    poses = np.column_stack([rng.uniform(-2, 2, 10), rng.uniform(-2, 2, 10), rng.uniform(-4, 4, 10)])
    found = cast(grid, poses, FULL_TURN.angles, 20.0)
    assert np.isfinite(found).mean() > 0.99
    assert np.nanmedian(np.abs(found - scan(FULL_TURN, scene, poses, rng))) < 0.1


def test_what_is_not_known_has_no_range():
    cells = np.full((4, 10), FREE, np.uint8)
    cells[0, 6] = UNKNOWN
    cells[1, 7:9] = OCCUPIED
    grid = OccupancyGrid(cells, 1.0, (0.0, 0.0))
    poses = [[0.5, 0.5, 0.0], [0.5, 1.5, 0.0], [0.5, 2.5, 0.0], [-3.0, 1.5, 0.0], [7.2, 1.5, 0.0], [6.5, 0.5, 1.0]]
    into_unknown, into_wall, out_of_grid, outside, in_wall, in_unknown = cast(grid, poses, [0.0], 30.0)[:, 0]
    assert np.isnan([into_unknown, out_of_grid, outside, in_unknown]).all()
    assert into_wall == pytest.approx(7.0)  # the middle of the cell from 7 to 8, seen from 0.5
    assert in_wall == pytest.approx(0.4)  # half the way that is left in it
    assert cast(grid, poses, [0.0], 5.0)[:3, 0].tolist() == [5.0, 5.0, 5.0]
