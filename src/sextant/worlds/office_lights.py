"""Lamps and windows of a floor as lights, room by room, and the contact shadows of its furniture."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int32
from numpy import ndarray
from scipy import ndimage

from sextant.worlds.lamps import Lamps
from sextant.worlds.office_plan import CEILING_M, HEAD_M, SILL_M, WALL_M, Box, FloorPlan, Room, RoomKind, Side, Window
from sextant.worlds.shading.interior import SHADOW_STEPS

#: side of a cell in metres, and lights kept per cell
CELL_M, NEAREST = 0.1, 9


@dataclass(frozen=True)
class RoomLights(Lamps):
    """Lights that shine only in their own room.

    Attributes:
        position: ceiling lamps and the centres of windows, distinguished by height.
        cells: the lights of the room that a cell is in, nearest first, -1 for none; last, the shadow of furniture on
            the floor, 0 to ``SHADOW_STEPS``.
        origin: x and y of the grid's corner, and side of a cell.
    """

    cells: Int32[ndarray, "gx gy k"]


def lattice(room: Room) -> tuple[int, int]:
    """How many lamps hang along x and along y."""
    if room.kind is RoomKind.CORRIDOR:
        return tuple(1 if side < 3.5 else max(1, round(side / 3.2)) for side in (room.width, room.depth))  # type: ignore[return-value]
    return max(1, round(room.width / 2.6)), max(1, round(room.depth / 2.6))


def room_lamps(room: Room) -> Float64[ndarray, "n 3"]:
    """Where its lamps hang, in the frame of the plan."""
    columns, rows = lattice(room)
    x = room.box[0] + (np.arange(columns) + 0.5) * room.width / columns
    y = room.box[1] + (np.arange(rows) + 0.5) * room.depth / rows
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    return np.column_stack([grid, np.full(len(grid), CEILING_M - 0.02)])


def window_light(room: Room, window: Window) -> Float64[ndarray, "3"]:
    """The centre of a window, slightly inside the room."""
    x, y = room.start(window.side)
    s = (window.start + window.end) / 2
    dx, dy = ((1, 0), (0, 1), (-1, 0), (0, -1))[window.side]
    return np.array([x + dx * s - 0.15 * dy, y + dy * s + 0.15 * dx, (SILL_M + HEAD_M) / 2])


def _niche(room: Room, window: Window) -> Box:
    """Where the glass of a window is."""
    x, y = room.start(window.side)
    dx, dy = ((1, 0), (0, 1), (-1, 0), (0, -1))[window.side]
    ends = [(x + s * dx + 0.25 * dy, y + s * dy - 0.25 * dx) for s in (window.start, window.end)]
    ends += [(x + window.start * dx, y + window.start * dy)]
    return min(p[0] for p in ends), min(p[1] for p in ends), max(p[0] for p in ends), max(p[1] for p in ends)


def room_fills(plan: FloorPlan, lit_by_day: Float64[ndarray, "n"]) -> list[tuple[float, float, float]]:
    """For each room: light scattered from lamps and from windows, and the share of its lamps that are on by day."""
    glass = np.zeros(len(plan.rooms))
    for window in plan.windows:
        glass[window.room] += (window.end - window.start) * (HEAD_M - SILL_M)
    fills = []
    for room, area, lit in zip(plan.rooms, glass, lit_by_day, strict=True):
        columns, rows = lattice(room)
        lamp = 0.2 + 0.55 * min(columns * rows / room.area_m2, 0.3)
        fills.append((lamp, float(min(0.03 + 1.5 * area / room.area_m2, 0.34)), float(lit)))
    return fills


def room_lights(plan: FloorPlan, footprints: list[tuple[Box, float]]) -> RoomLights:
    """The lights of a plan, in the world.

    Args:
        footprints: boxes of furniture in the frame of the plan, and the darkness of the shadow each casts, 0 to 1.
    """
    lights = [room_lamps(room) for room in plan.rooms]
    for window in plan.windows:
        lights[window.room] = np.vstack([lights[window.room], window_light(plan.rooms[window.room], window)])
    position = np.concatenate(lights)
    first = np.cumsum([0] + [len(part) for part in lights])
    left, bottom, right, top = plan.bounds
    origin = np.array([left - CELL_M, bottom - CELL_M, CELL_M])
    shape = tuple(int(np.ceil(side / CELL_M)) + 2 for side in (right - left, top - bottom))
    cells = np.full((*shape, NEAREST + 1), -1, np.int32)
    dark = np.zeros(shape)
    grid = _Grid(plan, origin, shape)
    for door in plan.doors:
        _light(cells, grid, door.box, 0.3, position, first[door.rooms[0]], first[door.rooms[0] + 1])
    for window in plan.windows:
        i = window.room
        _light(cells, grid, _niche(plan.rooms[i], window), 0.15, position, first[i], first[i + 1])
    for i, room in enumerate(plan.rooms):
        _light(cells, grid, room.box, WALL_M / 2, position, first[i], first[i + 1])
    for box, depth in footprints:
        part, inside, _ = grid.within(box, 0.0)
        dark[part] = np.maximum(dark[part], np.where(inside, depth, 0.0))
    soft = 0.6 * ndimage.gaussian_filter(dark, 0.9) + 0.4 * ndimage.gaussian_filter(dark, 2.8)
    cells[..., NEAREST] = np.rint(SHADOW_STEPS * soft)
    world = np.column_stack([plan.to_world(position[:, :2]), position[:, 2]])
    return RoomLights(np.ascontiguousarray(world), np.ascontiguousarray(cells), origin)


@dataclass(frozen=True)
class _Grid:
    """Cells in the world that know where they are in the plan."""

    plan: FloorPlan
    origin: Float64[ndarray, "3"]
    shape: tuple[int, ...]

    def within(self, box: Box, margin: float) -> tuple[tuple[slice, slice], ndarray, ndarray]:
        """The cells around a box of the plan, which of them are within ``margin`` of it, and their positions."""
        x0, y0, x1, y1 = box[0] - margin, box[1] - margin, box[2] + margin, box[3] + margin
        corners = self.plan.to_world(np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]))
        low = np.clip(np.floor((corners.min(0) - self.origin[:2]) / CELL_M).astype(int) - 1, 0, self.shape)
        high = np.clip(np.ceil((corners.max(0) - self.origin[:2]) / CELL_M).astype(int) + 1, 0, self.shape)
        part = (slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1])))
        index = np.stack(np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]), indexing="ij"), -1)
        xy = self.plan.to_plan(self.origin[:2] + (index + 0.5) * CELL_M)
        inside = (xy[..., 0] >= x0) & (xy[..., 0] < x1) & (xy[..., 1] >= y0) & (xy[..., 1] < y1)
        return part, inside, xy


def _light(
    cells: Int32[ndarray, "gx gy k"],
    grid: _Grid,
    box: Box,
    margin: float,
    position: Float64[ndarray, "n 3"],
    first: int,
    end: int,
) -> None:
    """Writes the lights ``first`` to ``end`` into the cells of a box, nearest first."""
    part, inside, xy = grid.within(box, margin)
    squared = ((xy[..., None, :] - position[first:end, :2]) ** 2).sum(-1)
    kept = min(NEAREST, end - first)
    nearest = np.argsort(squared, axis=-1, kind="stable")[..., :kept].astype(np.int32) + np.int32(first)
    block = cells[part]
    block[inside, :NEAREST] = -1
    block[..., :kept][inside] = nearest[inside]


__all__ = ["RoomLights", "Side", "lattice", "room_fills", "room_lamps", "room_lights"]
