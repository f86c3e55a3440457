"""The ground of a town: carriageways, pavements and lots, from a street graph."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely
from jaxtyping import Float64
from numpy import ndarray
from shapely import Polygon
from shapely.geometry import LineString
from shapely.ops import unary_union

from sextant.worlds.mesh import Mesh, instances, quads
from sextant.worlds.street_graph import StreetGraph
from sextant.worlds.surfaces import Kind, palette, surface_rows

#: width of pavements, height of kerbs
PAVEMENT_M, KERB_M = 3.4, 0.12
#: how far the last block extends beyond the streets, and the fields around it
COUNTRY_M, FAR_M = 900.0, 6000.0


@dataclass(frozen=True)
class Side:
    """A straight piece of a lot line; the lot lies to its left.

    Attributes:
        start, end: metres.
        block: number of the block.
    """

    start: Float64[ndarray, "2"]
    end: Float64[ndarray, "2"]
    block: int

    @cached_property
    def length(self) -> float:
        """Metres."""
        return float(np.hypot(*(self.end - self.start)))

    @cached_property
    def along(self) -> Float64[ndarray, "2"]:
        """Unit vector from start to end."""
        return np.asarray((self.end - self.start) / self.length)

    @property
    def heading(self) -> float:
        """Direction of ``along``, radians."""
        return float(np.arctan2(*self.along[::-1]))

    def at(self, s: float, left: float) -> Float64[ndarray, "2"]:
        """The point ``s`` metres along and ``left`` metres into the lot."""
        (x, y), (u, v) = self.start.tolist(), self.along.tolist()
        return np.array([x + s * u - left * v, y + s * v + left * u])


class Ground:
    """Carriageways, blocks with pavements, and lots. The last block is the countryside around the town."""

    def __init__(self, graph: StreetGraph):
        self.graph = graph
        lines = [
            LineString(graph.nodes[edge]).buffer(width / 2, quad_segs=3)
            for edge, width in zip(graph.edges, graph.widths, strict=True)
        ]
        roads = unary_union(lines)
        roads = roads.buffer(4.0, quad_segs=3).buffer(-4.0, quad_segs=3)  # rounded kerbs
        left, bottom, right, top = graph.bounds
        country = shapely.box(left - COUNTRY_M, bottom - COUNTRY_M, right + COUNTRY_M, top + COUNTRY_M)
        pieces = [p for p in _polygons(country.difference(roads)) if p.area > 60]
        outer = max(range(len(pieces)), key=lambda i: pieces[i].envelope.area)
        pieces.append(pieces.pop(outer))
        self.roads = roads
        self.blocks: list[Polygon] = [shapely.simplify(p, 0.05) for p in pieces]

    @cached_property
    def lots(self) -> list[Polygon]:
        """What the pavements leave of each block: the largest piece, empty where nothing is left."""
        insets = [block.buffer(-PAVEMENT_M, quad_segs=2) for block in self.blocks]
        return [max(_polygons(inset), key=lambda p: p.area, default=Polygon()) for inset in insets]

    def sides(self, block: int, inset: float = 0.0, shortest_m: float = 6.0) -> Iterator[Side]:
        """Straight pieces of the line ``inset`` metres inside the lot of ``block`` (``-PAVEMENT_M`` gives the kerb)."""
        area = self.lots[block] if inset == 0 else self.lots[block].buffer(-inset, quad_segs=2)
        country = block == len(self.blocks) - 1
        for polygon in _polygons(area):
            whole = shapely.geometry.polygon.orient(shapely.simplify(polygon, 0.9))
            rings = list(whole.interiors) if country else [whole.exterior, *whole.interiors]
            for ring in rings:
                corners = np.asarray(ring.coords)
                for start, end in pairwise(corners):
                    side = Side(start, end, block)
                    if side.length >= shortest_m:
                        yield side

    def mesh(self, green: list[bool]) -> Mesh:
        """Triangles of the ground; the lot of block ``i`` is a lawn if ``green[i]``, and paved otherwise."""
        left, bottom, right, top = self.graph.bounds
        corners = np.array([
            [left - FAR_M, bottom - FAR_M, 0],
            [right + FAR_M, bottom - FAR_M, 0],
            [right + FAR_M, top + FAR_M, 0],
            [left - FAR_M, top + FAR_M, 0],
        ])  # fmt: skip
        base = surface_rows(Kind.ROAD, 1, parameters=(1e4, 1e4, 0.0))
        parts = [instances(quads(corners[None]).reshape(1, 2, 3, 3), base), self._streets()]
        for i, (block, lot) in enumerate(zip(self.blocks, self.lots, strict=True)):
            kind = Kind.FIELD if i == len(self.blocks) - 1 else (Kind.GRASS if green[i] else Kind.PAVEMENT)
            longest = max(self.sides(i, shortest_m=0.5), key=lambda side: side.length, default=None)
            heading = longest.heading if longest else 0.0
            paving = surface_rows(Kind.PAVEMENT, 1, seed=(i * 0.37) % 1, heading=heading)
            parts.append(flat(block.difference(lot), KERB_M, paving))
            parts.append(flat(lot, KERB_M, surface_rows(kind, 1, seed=(i * 0.61) % 1, heading=heading)))
            parts.append(_kerb(block))
        parts.append(_far_country(self.graph.bounds))
        return Mesh.join(parts)

    def _streets(self) -> Mesh:
        """A strip for the markings of each street, just above the asphalt, ending short of the junctions."""
        graph = self.graph
        ends = graph.nodes[graph.edges]  # (e, 2, 2)
        along = (ends[:, 1] - ends[:, 0]) / graph.lengths[:, None]
        degree = graph.degrees[graph.edges]
        widest = np.zeros(len(graph.nodes))
        for column in range(2):
            np.maximum.at(widest, graph.edges[:, column], graph.widths)
        back = np.where(degree > 2, 0.5 * widest[graph.edges] + 2.5, 0.0)
        fits = graph.lengths - back.sum(1) > 4
        start = ends[:, 0] + along * back[:, :1]
        end = ends[:, 1] - along * back[:, 1:]
        normal = np.stack([-along[:, 1], along[:, 0]], -1) * (graph.widths[:, None] / 2 - 0.06)
        z = 0.004 + 0.002 * self._levels()[:, None]
        corners = np.stack([np.hstack([p, z]) for p in (start - normal, end - normal, end + normal, start + normal)], 1)
        crossing = (degree > 2).astype(float) * (np.random.default_rng([3, len(start)]).random(degree.shape) < 0.6)
        markings = np.where(graph.widths > 9, 2.0, 1.0)
        rows = surface_rows(
            Kind.ROAD, len(start), seed=np.random.default_rng([4, len(start)]).random(len(start)),
            origin=np.hstack([start, 0 * z]), heading=np.arctan2(along[:, 1], along[:, 0]),
            parameters=(np.linalg.norm(end - start, axis=1), graph.widths / 2, markings, *crossing.T),
        )  # fmt: skip
        return instances(quads(corners)[fits], rows[fits])

    def _levels(self) -> Float64[ndarray, "e"]:
        """0, 1 or 2 for each street: strips that meet at a bend overlap and must not be coplanar."""
        graph = self.graph
        levels = np.full(len(graph.edges), -1.0)
        for e, ends in enumerate(graph.edges.tolist()):
            bends = [node for node in ends if graph.degrees[node] == 2]
            near = {levels[graph.edge_between(node, other) or 0] for node in bends for other in graph.neighbours[node]}
            levels[e] = min({0.0, 1.0, 2.0} - near)
        return levels


def _polygons(shape: shapely.Geometry) -> list[Polygon]:
    return [p for p in shapely.get_parts(shape).tolist() if isinstance(p, Polygon) and not p.is_empty]


def flat(shape: shapely.Geometry, z: float, row: Float64[ndarray, "1 24"]) -> Mesh:
    """A level area, triangulated."""
    triangles = []
    for polygon in _polygons(shape):
        for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(polygon)).tolist():
            corners = np.asarray(shapely.geometry.polygon.orient(triangle).exterior.coords)[:3]
            triangles.append(np.column_stack([corners, np.full(3, z)]))
    if not triangles:
        return Mesh.empty()
    return instances(np.array(triangles)[None], row)


def _kerb(block: Polygon) -> Mesh:
    """The vertical edge of a pavement."""
    faces = []
    whole = shapely.geometry.polygon.orient(block)
    for ring in (whole.exterior, *whole.interiors):
        corners = np.asarray(ring.coords)
        low, high = (np.column_stack([corners, np.full(len(corners), z)]) for z in (0.0, KERB_M))
        faces.append(quads(np.stack([low[:-1], low[1:], high[1:], high[:-1]], 1)).reshape(-1, 3, 3))
    stone = surface_rows(Kind.KERB, 1, colour=palette("#b4b0a8"))
    return instances(np.concatenate(faces)[None], stone)


def _far_country(bounds: tuple[float, float, float, float]) -> Mesh:
    """Fields from the edge of the blocks to the horizon."""
    left, bottom, right, top = bounds
    hole = shapely.box(left - COUNTRY_M, bottom - COUNTRY_M, right + COUNTRY_M, top + COUNTRY_M)
    rim = shapely.box(left - FAR_M, bottom - FAR_M, right + FAR_M, top + FAR_M).difference(hole)
    return flat(rim, KERB_M, surface_rows(Kind.FIELD, 1))
