"""Roofs of buildings, one function for each form."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray

from sextant.worlds.building_design import FLAT, GABLE, HIP, MANSARD, Buildings, Number
from sextant.worlds.mesh import Mesh, instances, place, quads
from sextant.worlds.surfaces import Kind, surface_rows

GRAVEL, SLATE = np.array([0.21, 0.205, 0.2]), np.array([0.09, 0.095, 0.105])
#: overhang of a pitched roof beyond the walls, and thickness of its edge, metres
OVERHANG_M, EDGE_M = 0.42, 0.2

Corner = Float64[ndarray, "n 3"]
Faces = list[Float64[ndarray, "n 4 3"]]


@dataclass(frozen=True)
class _Top:
    """What roofs stand on, in frames rotated so that x runs along the ridge.

    Attributes:
        length, span: of the footprint, along the ridge and across it.
        height: of the walls.
        rise: of the roof above them.
        joined: whether the roof continues into a neighbour's at -x and at +x.
    """

    length: Float64[ndarray, "n"]
    span: Float64[ndarray, "n"]
    height: Float64[ndarray, "n"]
    rise: Float64[ndarray, "n"]
    joined: Bool[ndarray, "n 2"]

    @classmethod
    def of(cls, b: Buildings, at: Int64[ndarray, "k"]) -> "_Top":
        """The tops of the buildings ``at``."""
        across = b.across[at]
        length, span = (np.where(across, b.size[at, k], b.size[at, 1 - k]) for k in (1, 0))
        return cls(length, span, b.size[at, 2], b.rise[at], b.attached[at] & ~across[:, None])

    def point(self, x: Number, y: Number, z: Number) -> Corner:
        """A point on each."""
        return np.stack([np.broadcast_to(np.asarray(v, float), len(self.length)) for v in (x, y, z)], -1)

    def where_free(self, metres: Number) -> tuple[Float64[ndarray, "n"], Float64[ndarray, "n"]]:
        """``metres`` at -x and at +x, but 0 where there is a neighbour."""
        return np.where(self.joined[:, 0], 0.0, metres), np.where(self.joined[:, 1], 0.0, metres)

    def outline(self, z: Number) -> tuple[Corner, Corner, Corner, Corner]:
        """Corners of the footprint at height ``z``, counter-clockwise from the front left."""
        x, y = self.length / 2, self.span / 2
        return self.point(-x, -y, z), self.point(x, -y, z), self.point(x, y, z), self.point(-x, y, z)


def roofs(b: Buildings, tile: Float64[ndarray, "n 3"], seed: Float64[ndarray, "n"]) -> Mesh:
    """Roofs of all buildings; ``tile`` is the colour of those that are tiled."""
    return Mesh.join(_roofs_of(form, b, tile, seed) for form in _FACES)


def _roofs_of(form: int, b: Buildings, tile: Float64[ndarray, "n 3"], seed: Float64[ndarray, "n"]) -> Mesh:
    at = np.flatnonzero(b.roof == form)
    if not len(at):
        return Mesh.empty()
    triangles = quads(np.stack(_FACES[form](_Top.of(b, at)), 1)).reshape(len(at), -1, 3, 3)
    first, second = triangles[:, :, 1] - triangles[:, :, 0], triangles[:, :, 2] - triangles[:, :, 0]
    solid = (np.linalg.norm(np.cross(first, second), axis=-1) > 0).any(0)  # half of a triangular end's quad is empty
    heading = b.heading[at] + np.where(b.across[at], np.pi / 2, 0.0)
    level = np.zeros(len(at))
    rows = surface_rows(
        Kind.ROOF,
        len(at),
        seed=seed[at],
        colour={FLAT: GRAVEL, MANSARD: SLATE}.get(form, tile[at]),
        origin=b.position[at] + np.column_stack([level, level, b.size[at, 2]]),
        heading=heading,
        parameters=(1.0 if form == FLAT else 0.0,),
    )
    return instances(place(triangles[:, solid], b.position[at], heading), rows)


def _flat(top: _Top) -> Faces:
    return [np.stack(top.outline(top.height), 1)]


def _mansard(top: _Top) -> Faces:
    """Steep slopes all round, and a shallow top with a ridge; straight ends where there is a neighbour."""
    inset = 0.32 * top.rise
    left, right = top.where_free(inset)
    x0, x1, y, z = -top.length / 2 + left, top.length / 2 - right, top.span / 2, top.height + top.rise
    low = top.outline(top.height)
    high = (
        top.point(x0, -y + inset, z),
        top.point(x1, -y + inset, z),
        top.point(x1, y - inset, z),
        top.point(x0, y - inset, z),
    )
    start, end = top.point(x0, 0.0, z + 0.5), top.point(x1, 0.0, z + 0.5)
    return [
        *(np.stack([low[k], low[(k + 1) % 4], high[(k + 1) % 4], high[k]], 1) for k in range(4)),
        np.stack([high[0], high[1], end, start], 1),
        np.stack([high[2], high[3], start, end], 1),
        np.stack([high[1], high[2], end, end], 1),
        np.stack([high[3], high[0], start, start], 1),
    ]


def _gable(top: _Top) -> Faces:
    left, right = top.where_free(OVERHANG_M)
    return _pitched(top, (-left, -right), hipped=False)


def _hip(top: _Top) -> Faces:
    return _pitched(top, top.where_free(np.minimum(top.span / 2, 0.42 * top.length)), hipped=True)


def _pitched(top: _Top, inset: tuple[Float64[ndarray, "n"], Float64[ndarray, "n"]], *, hipped: bool) -> Faces:
    """Two slopes, with sloping ends if ``hipped``, their edges, and the undersides of the eaves.

    Args:
        inset: distance from either end of the walls to the end of the ridge.
    """
    x, y, h = top.length / 2, top.span / 2, top.height
    left, right = top.where_free(OVERHANG_M)
    eave = h - top.rise / y * OVERHANG_M
    a, c = top.point(-x - left, -y - OVERHANG_M, eave), top.point(x + right, -y - OVERHANG_M, eave)
    d, e = top.point(x + right, y + OVERHANG_M, eave), top.point(-x - left, y + OVERHANG_M, eave)
    start, end = top.point(-x + inset[0], 0.0, h + top.rise), top.point(x - inset[1], 0.0, h + top.rise)
    faces = [np.stack([a, c, end, start], 1), np.stack([d, e, start, end], 1)]
    if hipped:
        faces += [np.stack([c, d, end, end], 1), np.stack([e, a, start, start], 1)]
    drop = np.array([0.0, 0.0, -EDGE_M])
    rim = ((a, c), (d, e), (start, a), (c, end), (end, d), (e, start))
    faces += [np.stack([low + drop, high + drop, high, low], 1) for low, high in rim]
    wall = top.outline(h - EDGE_M)
    faces.append(np.stack([c + drop, a + drop, wall[0], wall[1]], 1))
    faces.append(np.stack([e + drop, d + drop, wall[2], wall[3]], 1))
    return faces


_FACES: dict[int, Callable[[_Top], Faces]] = {FLAT: _flat, GABLE: _gable, HIP: _hip, MANSARD: _mansard}
