r"""Ray casting: where beams end in an occupancy grid.

A ray visits the cells on its way one by one (J. Amanatides & A. Woo, "A fast voxel traversal algorithm for ray
tracing", Eurographics 1987) and ends in the first that is not free. Where the centre of the nearest such cell is
:math:`d` cells away from that of the ray's own cell, no point of it is nearer than :math:`d - \sqrt 2` to the ray.
The ray skips that far, which gives the same result in fewer steps.

A surface lies somewhere in the occupied cell, so its distance is taken to be that of the midpoint of the ray's way
through the cell. Rays that meet an unknown cell first, or leave the grid, have no known range (nan). Rays that reach
the maximum range in free cells end there.
"""

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray
from scipy import ndimage

from sextant.compiled import compiled
from sextant.worlds.occupancy import FREE, OccupancyGrid


def free_steps(grid: OccupancyGrid) -> Float32[ndarray, "rows columns"]:
    """The number of cells that a ray may skip from anywhere in each cell without meeting one that is not free."""
    free = grid.cells == FREE
    if free.all():
        # no cell ends a ray: only the border of the grid does, and the traversal finds it
        return np.zeros(free.shape, np.float32)
    distance = ndimage.distance_transform_edt(free)
    return np.asarray(np.maximum(distance - np.sqrt(2), 0.0), np.float32)


def ray_ranges(
    grid: OccupancyGrid,
    steps: Float32[ndarray, "rows columns"],
    poses: Float64[ndarray, "n 3"],
    angles: Float64[ndarray, " k"],
    max_range_m: float,
) -> Float64[ndarray, "n k"]:
    """Distance in metres from each pose to the first occupied cell along each beam; nan where it is not known.

    Args:
        grid: the map.
        steps: result of `free_steps`.
        poses: x, y in metres and heading in radians.
        angles: angles of the beams from the heading in radians.
        max_range_m: reach, the largest distance returned.
    """
    out = np.empty((len(poses), len(angles)))
    beams = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    _cast(poses, beams, grid.cells, steps, *grid.origin, grid.resolution_m, max_range_m, out)
    return out


@compiled
def _cast(poses, beams, cells, steps, left, bottom, resolution, reach_m, out):  # type: ignore[no-untyped-def]
    """Write ranges ``(n, k)`` in metres; see `ray_ranges`. Lengths inside the function are in cells."""
    rows, columns = cells.shape
    reach = reach_m / resolution
    for number in range(len(poses)):
        x, y = (poses[number, 0] - left) / resolution, (poses[number, 1] - bottom) / resolution
        cosine, sine = np.cos(poses[number, 2]), np.sin(poses[number, 2])
        for beam in range(len(beams)):
            dx = cosine * beams[beam, 0] - sine * beams[beam, 1]
            dy = sine * beams[beam, 0] + cosine * beams[beam, 1]
            out[number, beam] = np.nan
            if not (0.0 <= x < columns and 0.0 <= y < rows):  # true for nan too
                continue
            # a ray along an axis never leaves through the sides it runs parallel to
            per_x, ahead_x = (1 / dx, dx > 0) if dx != 0 else (np.inf, 2)
            per_y, ahead_y = (1 / dy, dy > 0) if dy != 0 else (np.inf, 2)
            column, row, travelled = int(x), int(y), 0.0
            while 0 <= column < columns and 0 <= row < rows:
                # where the ray leaves the cell, computed from whole numbers so that rounding does not accumulate
                to_x = (column + ahead_x - x) * per_x
                to_y = (row + ahead_y - y) * per_y
                leaves = max(min(to_x, to_y), travelled)
                if cells[row, column] != 0:
                    if cells[row, column] == 1:
                        out[number, beam] = min((travelled + leaves) / 2, reach) * resolution
                    break
                skip = travelled + steps[row, column]
                if skip > leaves:
                    travelled = skip
                    column, row = int(np.floor(x + travelled * dx)), int(np.floor(y + travelled * dy))
                else:
                    travelled = leaves
                    if to_x < to_y:
                        column += 1 if dx > 0 else -1
                    else:
                        row += 1 if dy > 0 else -1
                if travelled >= reach:
                    if 0 <= x + reach * dx <= columns and 0 <= y + reach * dy <= rows:  # not skipped out of the grid
                        out[number, beam] = reach_m
                    break
