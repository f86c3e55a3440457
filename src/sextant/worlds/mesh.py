"""Triangle meshes with a surface for each triangle, and the primitives that worlds are assembled from.

Every primitive builds many objects at once: its arguments have a leading dimension of size ``n``.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int, Int32
from numpy import ndarray

from sextant.worlds.surfaces import COLUMNS


@dataclass(frozen=True)
class Mesh:
    """Triangles in the world frame (metres, z up), counter-clockwise when seen from outside.

    Attributes:
        triangles: their corners, in float32 because the ray caster works in it: these values *are* the geometry.
        surface: the row of ``surfaces`` for each triangle.
        surfaces: the surface table (see ``surfaces.py``).
    """

    triangles: Float32[ndarray, "t 3 3"]
    surface: Int32[ndarray, "t"]
    surfaces: Float32[ndarray, "s 24"]

    def __len__(self) -> int:
        return len(self.triangles)

    @classmethod
    def empty(cls) -> "Mesh":
        """A mesh without triangles."""
        return cls(np.zeros((0, 3, 3), np.float32), np.zeros(0, np.int32), np.zeros((0, COLUMNS), np.float32))

    @classmethod
    def join(cls, meshes: Iterable["Mesh"]) -> "Mesh":
        """All meshes as one; rows of the surface tables are renumbered."""
        parts = [mesh for mesh in meshes if len(mesh)]
        if not parts:
            return cls.empty()
        starts = np.cumsum([0] + [len(mesh.surfaces) for mesh in parts[:-1]])
        return cls(
            np.concatenate([mesh.triangles for mesh in parts]),
            np.concatenate([mesh.surface + np.int32(start) for mesh, start in zip(parts, starts, strict=True)]),
            np.concatenate([mesh.surfaces for mesh in parts]),
        )


def instances(
    triangles: Float[ndarray, "n t 3 3"],
    surfaces: Float32[ndarray, "s 24"],
    surface: Int[ndarray, "n t"] | None = None,
) -> Mesh:
    """A mesh of ``n`` objects with ``t`` triangles each; object ``i`` has surface ``i`` unless ``surface`` is given."""
    n, t = triangles.shape[:2]
    rows = np.broadcast_to(np.arange(n)[:, None], (n, t)) if surface is None else surface
    return Mesh(triangles.reshape(-1, 3, 3).astype(np.float32), rows.reshape(-1).astype(np.int32), surfaces)


def place(
    triangles: Float[ndarray, "t 3 3"] | Float[ndarray, "n t 3 3"],
    position: Float[ndarray, "n 3"],
    heading: Float[ndarray, "n"],
) -> Float[ndarray, "n t 3 3"]:
    """One template ``(t, 3, 3)`` for all objects, or one for each, rotated by ``heading`` about z and moved."""
    c, s = np.cos(heading)[:, None, None], np.sin(heading)[:, None, None]
    x, y, z = np.moveaxis(np.broadcast_to(triangles, (len(position), *triangles.shape[-3:])), -1, 0)
    return np.asarray(np.stack([c * x - s * y, s * x + c * y, z], -1) + position[:, None, None])


def quads(corners: Float[ndarray, "... 4 3"]) -> Float[ndarray, "... 2 3 3"]:
    """Two triangles for each quadrilateral, with corners counter-clockwise when seen from the front."""
    return np.stack([corners[..., [0, 1, 2], :], corners[..., [0, 2, 3], :]], -3)


#: corners of the unit box that stands on the origin, and its six faces, pointing outwards
_BOX = np.array([(x, y, z) for z in (0, 1) for y in (-0.5, 0.5) for x in (-0.5, 0.5)], float)
_FACES = np.array([(0, 1, 5, 4), (1, 3, 7, 5), (3, 2, 6, 7), (2, 0, 4, 6), (4, 5, 7, 6), (2, 3, 1, 0)])


def box_triangles(
    base: Float[ndarray, "n 3"], size: Float[ndarray, "n 3"], heading: Float[ndarray, "n"], *, bottom: bool = False
) -> Float[ndarray, "n t 3 3"]:
    """Boxes that stand on ``base`` (the centre of their underside), 10 triangles each, 12 with the underside."""
    corners = _BOX[None] * size[:, None]  # (n, 8, 3)
    faces = corners[:, _FACES if bottom else _FACES[:5]]  # (n, f, 4, 3)
    triangles = quads(faces).reshape(len(base), -1, 3, 3)
    return place(triangles, base, heading)


def boxes(
    base: Float[ndarray, "n 3"],
    size: Float[ndarray, "n 3"],
    heading: Float[ndarray, "n"],
    surfaces: Float32[ndarray, "n 24"],
    *,
    bottom: bool = False,
) -> Mesh:
    """Boxes with one surface each; see ``box_triangles``."""
    return instances(box_triangles(base, size, heading, bottom=bottom), surfaces)


def prism(radius_bottom: float, radius_top: float, height: float, sides: int) -> Float[ndarray, "t 3 3"]:
    """A template: a frustum of ``sides`` sides on the origin, without underside, with a top unless it is a point."""
    angle = 2 * np.pi * np.arange(sides + 1) / sides
    ring = np.stack([np.cos(angle), np.sin(angle)], -1)
    low = np.concatenate([ring * radius_bottom, np.zeros((sides + 1, 1))], -1)
    high = np.concatenate([ring * radius_top, np.full((sides + 1, 1), height)], -1)
    walls = quads(np.stack([low[:-1], low[1:], high[1:], high[:-1]], 1)).reshape(-1, 3, 3)
    if radius_top == 0:
        return walls[::2]
    top = np.stack([np.broadcast_to([0, 0, height], (sides, 3)), high[:-1], high[1:]], 1)
    return np.concatenate([walls, top])


def limb(
    start: Float[ndarray, "3"], end: Float[ndarray, "3"], r0: float, r1: float, sides: int = 3
) -> Float[ndarray, "t 3 3"]:
    """A template: a tapered prism between two points, for branches, arms and rails."""
    axis = np.asarray(end, float) - np.asarray(start, float)
    length = float(np.linalg.norm(axis))
    axis = axis / length
    upright = abs(axis[2]) > 0.9
    side = np.cross(np.array([1.0, 0, 0]) if upright else np.array([0, 0, 1.0]), axis)
    side /= np.linalg.norm(side)
    frame = np.stack([side, np.cross(axis, side), axis], -1)  # columns
    return np.asarray(prism(r0, r1, length, sides) @ frame.T + np.asarray(start, float))
