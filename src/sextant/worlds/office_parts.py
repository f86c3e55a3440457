"""Boxes and panels in the frames of objects, collected into one mesh."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Float32, Float64
from numpy import ndarray

from sextant.worlds.mesh import Mesh, boxes, instances, place, quads
from sextant.worlds.surfaces import COLUMNS, COS, P0, SIN, Kind, X, Y, Z, surface_rows

#: the last three columns of an indoor row; see ``shading/interior.py``
FILLS = slice(P0 + 7, P0 + 10)
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Frame:
    """Where an object stands: x runs along its width, y away from its back, z up.

    Attributes:
        x, y: metres, in the frame of the plan.
        heading: direction of its x axis, radians.
        fills: lamp light, daylight and share of lamps that are on by day, of the room it is in.
    """

    x: float
    y: float
    heading: float
    fills: Point = (0.3, 0.1, 1.0)

    def at(self, x: float, y: float) -> tuple[float, float]:
        """A point of this frame in the frame of the plan."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        return float(self.x + c * x - s * y), float(self.y + s * x + c * y)

    def inner(self, x: float, y: float, turn: float = 0.0) -> "Frame":
        """A frame relative to this one."""
        return Frame(*self.at(x, y), self.heading + turn, self.fills)


@dataclass
class Parts:
    """A growing collection of boxes and panels."""

    _boxes: list[tuple[float, ...]] = field(default_factory=list)
    _box_rows: list[Float32[ndarray, "24"]] = field(default_factory=list)
    _meshes: list[Mesh] = field(default_factory=list)

    def box(
        self,
        frame: Frame,
        centre: Point,
        size: Point,
        colour: object,
        *,
        gloss: float = 0.05,
        kind: Kind = Kind.PLAIN,
        parameters: tuple[float, ...] | None = None,
        second: object = (0.5, 0.5, 0.5),
        seed: float = 0.0,
    ) -> None:
        """A box that stands on ``centre``; its texture starts at the left end of its width."""
        x, y, z = centre
        corner = frame.at(x - size[0] / 2, y)
        row = surface_rows(
            kind, 1, seed=seed, colour=colour, second=second, origin=(*corner, z), heading=frame.heading,
            parameters=(gloss,) if parameters is None else parameters,
        )[0]  # fmt: skip
        row[FILLS] = frame.fills
        self._boxes.append((*frame.at(x, y), z, *size, frame.heading))
        self._box_rows.append(row)

    def panel(
        self,
        frame: Frame,
        centre: Point,
        size: tuple[float, float],
        kind: Kind,
        colour: object,
        *,
        parameters: tuple[float, ...] = (),
        second: object = (0.5, 0.5, 0.5),
        seed: float = 0.0,
    ) -> None:
        """A vertical rectangle that faces y, with its lower edge at ``centre``."""
        x, y, z = centre
        width, height = size
        low, high = frame.at(x - width / 2, y), frame.at(x + width / 2, y)
        row = surface_rows(
            kind, 1, seed=seed, colour=colour, second=second, origin=(*low, z), heading=frame.heading,
            parameters=(width, height, *parameters),
        )  # fmt: skip
        row[:, FILLS] = frame.fills
        corners = np.array([(*low, z), (*low, z + height), (*high, z + height), (*high, z)])
        self._meshes.append(instances(quads(corners[None]).reshape(1, 2, 3, 3), row))

    def template(
        self,
        frame: Frame,
        triangles: Float64[ndarray, "t 3 3"],
        z: float,
        colour: object,
        *,
        gloss: float = 0.05,
        seed: float = 0.0,
    ) -> None:
        """Triangles given in the frame of the object, in one plain colour."""
        row = surface_rows(Kind.PLAIN, 1, seed=seed, colour=colour, origin=(frame.x, frame.y, z), parameters=(gloss,))
        row[:, FILLS] = frame.fills
        placed = place(triangles, np.array([[frame.x, frame.y, z]]), np.array([frame.heading]))
        self._meshes.append(instances(placed, row))

    def add(self, mesh: Mesh, fills: Point) -> None:
        """Add another mesh, lit as a room."""
        if len(mesh):
            mesh.surfaces[:, FILLS] = fills
            self._meshes.append(mesh)

    def mesh(self) -> Mesh:
        """All of it."""
        meshes = list(self._meshes)
        if self._boxes:
            table = np.array(self._boxes)
            rows = np.array(self._box_rows, np.float32).reshape(-1, COLUMNS)
            meshes.append(boxes(table[:, :3], table[:, 3:6], table[:, 6], rows, bottom=True))
        return Mesh.join(meshes)


def turned(mesh: Mesh, heading: float, origin: tuple[float, float]) -> Mesh:
    """A mesh and its textures, rotated about z and moved."""
    c, s = np.cos(heading), np.sin(heading)
    turn: Float[ndarray, "3 3"] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    shift = np.array([*origin, 0.0])
    rows = mesh.surfaces.astype(np.float64)
    rows[:, [X, Y, Z]] = rows[:, [X, Y, Z]] @ turn.T + shift
    cos, sin = rows[:, COS].copy(), rows[:, SIN].copy()
    rows[:, COS], rows[:, SIN] = c * cos - s * sin, s * cos + c * sin
    triangles = mesh.triangles.astype(np.float64) @ turn.T + shift
    return Mesh(triangles.astype(np.float32), mesh.surface, rows.astype(np.float32))
