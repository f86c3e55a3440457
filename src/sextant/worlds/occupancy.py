"""Occupancy grids: the maps of laser localizers.

Data sets should use `occupancy_from_scans` with the exact scanner along the mapping drive: this is the grid that a
mapping robot has, unknown where the laser never looked. `occupancy_from_scene` knows every wall within the bounds, even
the backs of houses; it is for checks and planning.
"""

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int64, UInt8
from numpy import ndarray
from scipy import ndimage

from sextant.errors import UserError
from sextant.worlds.laser import LaserScanner, RayCaster

FREE, OCCUPIED, UNKNOWN = 0, 1, 2
MAX_CELLS = 500_000_000
#: Log odds added by a beam that ends in a cell and by one that passes through, and the limit of their sum.
LOG_ODDS_HIT, LOG_ODDS_PASS, LOG_ODDS_LIMIT = 0.85, -0.4, 10.0
Bounds = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """Square cells, each free (0), occupied (1) or unknown (2).

    Attributes:
        cells: rows along y, columns along x.
        resolution_m: side of a cell.
        origin: x and y in metres of the outer corner of cell (0, 0).

    Raises:
        ValueError: a cell has another value, there are no cells, or the resolution is not positive.

    Example:
        >>> grid = OccupancyGrid(np.array([[0, 0, 1]], np.uint8), resolution_m=0.5, origin=(0.0, 0.0))
        >>> grid.state_at(np.array([[1.2, 0.2], [9.0, 9.0]]))  # in the last cell; outside
        array([1, 2], dtype=uint8)
        >>> grid.distance_m()
        array([[1. , 0.5, 0. ]])
    """

    cells: UInt8[ndarray, "rows columns"]
    resolution_m: float
    origin: tuple[float, float]

    def __post_init__(self) -> None:
        if self.cells.ndim != 2 or self.cells.size == 0 or self.cells.max() > UNKNOWN:
            raise ValueError(f"cells must be a table of 0, 1 and 2, got one of shape {self.cells.shape}")
        if not 0 < self.resolution_m < np.inf or not np.isfinite(self.origin).all():
            raise ValueError(f"resolution {self.resolution_m} or origin {self.origin} is not usable")

    def world_to_cell(self, points: Float[ndarray, "*n 2"]) -> Int64[ndarray, "*n 2"]:
        """Row and column of the cell that contains each point (x, y in metres), which may lie outside the grid."""
        return np.floor((points - self.origin) / self.resolution_m).astype(np.int64)[..., ::-1]

    def cell_to_world(self, cells: Int64[ndarray, "*n 2"]) -> Float[ndarray, "*n 2"]:
        """Centre (x, y in metres) of each cell (row, column)."""
        return np.asarray((cells[..., ::-1] + 0.5) * self.resolution_m + self.origin)

    def contains(self, cells: Int64[ndarray, "*n 2"]) -> Bool[ndarray, "*n"]:
        """Whether each cell (row, column) is in the grid."""
        return np.asarray(((cells >= 0) & (cells < self.cells.shape)).all(axis=-1))

    def state_at(self, points: Float[ndarray, "*n 2"]) -> UInt8[ndarray, "*n"]:
        """State of the cell that contains each point (x, y in metres); unknown outside the grid."""
        at = self.world_to_cell(points)
        known = self.contains(at)
        row, column = np.moveaxis(np.where(known[..., None], at, 0), -1, 0)
        return np.where(known, self.cells[row, column], np.uint8(UNKNOWN))

    def distance_m(self) -> Float[ndarray, "rows columns"]:
        """Metres from the centre of each cell to that of the nearest occupied one; inf if none is occupied."""
        occupied = self.cells == OCCUPIED
        if not occupied.any():
            return np.full(self.cells.shape, np.inf)
        return np.asarray(ndimage.distance_transform_edt(~occupied, sampling=self.resolution_m))

    def save(self, path: Path | str) -> None:
        """Write the grid as a compressed npz file."""
        with Path(path).open("wb") as file:
            np.savez_compressed(file, cells=self.cells, resolution_m=self.resolution_m, origin=np.array(self.origin))

    @classmethod
    def load(cls, path: Path | str) -> "OccupancyGrid":
        """Read a grid written by `save`; nothing is unpickled.

        Raises:
            UserError: there is no such file, or it does not contain a grid.
        """
        try:
            with np.load(path, allow_pickle=False) as content:
                x, y = content["origin"].tolist()
                return cls(content["cells"].astype(np.uint8, casting="safe"), float(content["resolution_m"]), (x, y))
        except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise UserError(f"{path} is not an occupancy grid: {error}", "Make it again.") from None


def occupancy_from_scans(
    scanner: LaserScanner,
    poses: Float[ndarray, "n 3"],
    ranges: Float[ndarray, "n beams"],
    resolution_m: float,
    bounds: Bounds | None = None,
) -> OccupancyGrid:
    """Integrate scans from known poses by log odds: a cell is occupied above 0, free below, unknown at 0.

    Each scan adds 0.85 to cells where a beam ends and subtracts 0.4, once per cell, from other cells that a beam passes
    through, sampled every half cell; sums stay within ±10 (Thrun, Burgard & Fox 2005, table 9.1).

    Args:
        scanner: that made the scans; ranges of ``max_range_m`` hit no surface.
        poses: x, y in metres and heading in radians.
        ranges: metres.
        resolution_m: side of a cell.
        bounds: smallest x and y, largest x and y of the grid; by default as far as the beams reach.

    Raises:
        UserError: bounds or resolution are not usable.

    >>> ahead = LaserScanner(beams=1, max_range_m=10.0)  # from the origin along x
    >>> occupancy_from_scans(ahead, np.zeros((1, 3)), np.array([[2.25]]), 0.5, (-1.0, -0.5, 3.5, 0.5)).cells
    array([[2, 2, 2, 2, 2, 2, 2, 2, 2],
           [2, 2, 0, 0, 0, 0, 1, 2, 2]], dtype=uint8)
    """
    bearing = poses[:, 2:] + scanner.angles
    ends = poses[:, None, :2] + ranges[..., None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    if bounds is None:
        reached = np.concatenate([ends.reshape(-1, 2), poses[:, :2]])
        (left, bottom), (right, top) = reached.min(axis=0) - resolution_m, reached.max(axis=0) + resolution_m
        bounds = (float(left), float(bottom), float(right), float(top))
    blank = _blank(bounds, resolution_m)
    odds = np.zeros(blank.cells.size, np.float32)
    shares = (np.arange(int(np.ceil(2 * ranges.max() / resolution_m))) * resolution_m / 2)[:, None]  # (steps, 1)
    beyond = min(scanner.max_range_m, float(np.float32(scanner.max_range_m)))  # scans may have been kept in 32 bits
    for pose, end, reach in zip(poses, ends, ranges, strict=True):  # a scan at a time bounds the memory
        hit = _flat(blank, end[reach < beyond])
        along = (end - pose[:2]) / np.maximum(reach, 1e-12)[:, None]
        points = pose[:2] + shares[..., None] * along  # (steps, beams, 2)
        passed = np.setdiff1d(_flat(blank, points[shares < reach]), hit)
        odds[passed] += LOG_ODDS_PASS
        odds[np.unique(hit)] += LOG_ODDS_HIT
        seen = np.concatenate([passed, hit])
        odds[seen] = np.clip(odds[seen], -LOG_ODDS_LIMIT, LOG_ODDS_LIMIT)
    cells = np.where(odds > 0, OCCUPIED, np.where(odds < 0, FREE, UNKNOWN)).astype(np.uint8)
    return OccupancyGrid(cells.reshape(blank.cells.shape), blank.resolution_m, blank.origin)


def occupancy_from_scene(
    caster: RayCaster,
    bounds: Bounds,
    height_m: float,
    resolution_m: float,
    reachable_from: Float[ndarray, "k 2"] | None = None,
) -> OccupancyGrid:
    """Slice a scene at a height: cells that contain a surface are occupied.

    Rays along the middle of every row and column, in both directions, continue behind each surface they meet, up to the
    bounds. The outlines they mark have no gap that a path across cell sides could slip through.

    Args:
        caster: the scene.
        bounds: smallest x and y, largest x and y.
        height_m: of the slice.
        resolution_m: side of a cell.
        reachable_from: points (x, y) in the open, such as a route: cells are then free only where a path leads to them,
            and unknown elsewhere (inside houses). By default all are free.

    Raises:
        UserError: bounds or resolution are not usable.
    """
    blank = _blank(bounds, resolution_m)
    cells = np.full(blank.cells.shape, FREE, np.uint8)
    rows, columns = blank.cells.shape
    width, depth = columns * resolution_m, rows * resolution_m
    x, y = blank.origin
    middle_y = y + (np.arange(rows) + 0.5) * resolution_m
    middle_x = x + (np.arange(columns) + 0.5) * resolution_m
    for middle, axis, near, length in ((middle_y, 0, x, width), (middle_x, 1, y, depth)):
        for sign, start in ((1.0, near), (-1.0, near + length)):
            origins = np.full((len(middle), 3), height_m)
            origins[:, axis], origins[:, 1 - axis] = start, middle
            hits = _all_hits(caster, origins, axis, sign, length)
            cells.reshape(-1)[_flat(blank, hits)] = OCCUPIED
    if reachable_from is not None:
        parts = _parts(cells == FREE)
        seeds = blank.world_to_cell(reachable_from)
        seeds = seeds[blank.contains(seeds)]
        open_parts = np.setdiff1d(parts[seeds[:, 0], seeds[:, 1]], [0])
        cells[(cells == FREE) & ~np.isin(parts, open_parts)] = UNKNOWN
    return OccupancyGrid(cells, blank.resolution_m, blank.origin)


def _parts(free: Bool[ndarray, "rows columns"]) -> Int64[ndarray, "rows columns"]:
    """Number of the part, connected across sides, that each free cell belongs to; 0 elsewhere."""
    parts = np.zeros(free.shape, np.int64)
    ndimage.label(free, output=parts)
    return parts


def _all_hits(
    caster: RayCaster, origins: Float[ndarray, "n 3"], axis: int, sign: float, length_m: float, skip_m: float = 1e-3
) -> Float[ndarray, "k 2"]:
    """Every surface point (x, y) along parallel rays, each of which continues 1 mm behind what it meets."""
    direction = np.zeros((len(origins), 3))
    direction[:, axis] = sign
    travelled, rays, found = np.zeros(len(origins)), np.arange(len(origins)), [np.zeros((0, 2))]
    while len(rays):
        at = origins[rays] + travelled[rays, None] * direction[rays]
        travelled[rays] += caster.distance(at, direction[rays])
        rays = rays[travelled[rays] < length_m]
        found.append((origins[rays] + travelled[rays, None] * direction[rays])[:, :2])
        travelled[rays] += skip_m
    return np.concatenate(found)


def _blank(bounds: Bounds, resolution_m: float) -> OccupancyGrid:
    left, bottom, right, top = bounds
    if not 0 < resolution_m < np.inf or not np.isfinite(bounds).all() or right <= left or top <= bottom:
        raise UserError(
            f"resolution_m={resolution_m:g}, bounds {bounds}: resolution and both sides must be positive",
            "Try resolution_m=0.1 with bounds (left, bottom, right, top)",
        )
    rows, columns = int(np.ceil((top - bottom) / resolution_m)), int(np.ceil((right - left) / resolution_m))
    if rows * columns > MAX_CELLS:
        raise UserError(
            f"resolution_m={resolution_m:g} makes {rows} x {columns} cells, more than {MAX_CELLS:,}",
            f"Try resolution_m={2 * resolution_m * np.sqrt(rows * columns / MAX_CELLS):.2g}",
        )
    return OccupancyGrid(np.full((rows, columns), UNKNOWN, np.uint8), resolution_m, (left, bottom))


def _flat(grid: OccupancyGrid, points: Float[ndarray, "k 2"]) -> Int64[ndarray, " j"]:
    """Flat indices of the cells that contain points; points outside are left out."""
    at = grid.world_to_cell(points)
    at = at[grid.contains(at)]
    return np.asarray(at[:, 0] * grid.cells.shape[1] + at[:, 1])
