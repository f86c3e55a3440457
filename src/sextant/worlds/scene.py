"""A mesh to cast rays at: Embree finds the triangle, plane arithmetic in float64 the exact distance."""

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Bool, Float, Float64, Int32
from numpy import ndarray

from sextant.worlds.mesh import Mesh
from sextant.worlds.surfaces import KIND, Kind

#: the number that Embree returns where a ray hits nothing
MISS = -1
#: the largest number of rays that the functions below give to Embree at a time, which limits their memory
CHUNK = 1 << 20
FOLIAGE = (Kind.LEAVES, Kind.CONIFER)


class Scene:
    """The triangles of a world behind an Embree hierarchy. Casting releases the interpreter's lock: threads scale.

    Embree works in float32, which at three kilometres from the origin resolves a quarter of a millimetre. It is trusted
    only with *which* triangle a ray hits; the distance is that of the triangle's plane,
    ``t = (c - n . o) / (n . d)`` in float64.

    Args:
        mesh: the triangles.
        watertight: no ray slips between two triangles that share an edge; a third slower. Without it about four rays
            in a million do, at the edges of distant triangles.

    Attributes:
        normals: unit outward normals of the triangles.
        offsets: ``c = n . v0`` of each plane.
        surface: row of the surface table for each triangle.
        surfaces: the surface table.
    """

    def __init__(self, mesh: Mesh, *, watertight: bool = True):
        corners = mesh.triangles.astype(np.float64)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        solid = lengths > 1e-12  # slivers without area cannot be hit
        self.normals: Float64[ndarray, "t 3"] = normals[solid] / lengths[solid, None]
        self.offsets: Float64[ndarray, "t"] = np.einsum("ij,ij->i", self.normals, corners[solid, 0])
        self.surface: Int32[ndarray, "t"] = np.ascontiguousarray(mesh.surface[solid])
        self.surfaces = np.ascontiguousarray(mesh.surfaces)
        triangles = np.ascontiguousarray(mesh.triangles[solid])
        low, high = triangles.reshape(-1, 3).min(0), triangles.reshape(-1, 3).max(0)
        self.bounds: Float64[ndarray, "2 3"] = np.stack([low, high]).astype(np.float64)
        self._embree = EmbreeScene(robust=watertight)
        TriangleMesh(
            self._embree, triangles.reshape(-1, 3), np.arange(3 * len(triangles), dtype=np.int32).reshape(-1, 3)
        )

    def __len__(self) -> int:
        return len(self.normals)

    def hit(self, origins: Float[ndarray, "r 3"], directions: Float[ndarray, "r 3"]) -> Int32[ndarray, "r"]:
        """The nearest triangle along each ray, ``MISS`` where there is none."""
        return self._embree.run(_single(origins), _single(directions), query="INTERSECT")  # type: ignore[no-any-return]

    def blocked(self, origins: Float[ndarray, "r 3"], directions: Float[ndarray, "r 3"]) -> Int32[ndarray, "r"]:
        """Zero or more where something lies along the ray, ``MISS`` where nothing does."""
        return self._embree.run(_single(origins), _single(directions), query="OCCLUDED")  # type: ignore[no-any-return]

    def distance(self, origins: Float64[ndarray, "r 3"], directions: Float64[ndarray, "r 3"]) -> Float64[ndarray, "r"]:
        """Exact distance to the nearest triangle along unit ``directions``, metres; infinite on a miss."""
        distances = np.empty(len(origins))
        for start in range(0, len(origins), CHUNK):
            part = slice(start, start + CHUNK)
            distances[part] = self.plane_distance(
                origins[part], directions[part], self.hit(origins[part], directions[part])
            )
        return distances

    def inside(self, points: Float64[ndarray, "n 3"]) -> Bool[ndarray, "n"]:
        """Whether points lie within a solid: most of eight level rays from them first meet the back of a triangle.

        Foliage has no inside.
        """
        angle = 2 * np.pi * (np.arange(8) + 0.37) / 8
        directions = np.tile(np.stack([np.cos(angle), np.sin(angle), np.zeros(8)], -1), (len(points), 1))
        triangle = self.hit(np.repeat(points, 8, axis=0), directions)
        solid = (triangle != MISS) & ~np.isin(self.surfaces[self.surface[triangle], KIND], FOLIAGE)
        behind = solid & (np.einsum("ij,ij->i", self.normals[triangle], directions) > 0)
        return np.asarray(behind.reshape(-1, 8).sum(1) > 4)

    def plane_distance(
        self, origins: Float64[ndarray, "r 3"], directions: Float64[ndarray, "r 3"], triangle: Int32[ndarray, "r"]
    ) -> Float64[ndarray, "r"]:
        """Distance along unit ``directions`` to the plane of each ray's ``triangle``; infinite for ``MISS``."""
        normal = self.normals[triangle]
        along = np.einsum("ij,ij->i", normal, directions)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (self.offsets[triangle] - np.einsum("ij,ij->i", normal, origins)) / along
        return np.where(triangle == MISS, np.inf, t)


def _single(values: Float[ndarray, "r 3"]) -> Float[ndarray, "r 3"]:
    return np.ascontiguousarray(values, dtype=np.float32)
