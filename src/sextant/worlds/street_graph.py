"""A town as a plane graph: junctions and bends are nodes, straight pieces of street are edges."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from jaxtyping import Float, Int64
from numpy import ndarray


@dataclass(frozen=True, eq=False)
class StreetGraph:
    """Streets of a town in a plane with x to the east and y to the north, in metres.

    Every edge is a straight piece of street; at each bend of a street there is a node with two edges. Layouts of this
    package are plane (edges meet only at nodes), connected, and have no edges under about 25 m and no angles under 40
    degrees.

    Attributes:
        nodes: positions in metres.
        edges: the two nodes of each piece of street; a pair occurs once, in either order.
        widths: of the carriageway in metres, both lanes together, without pavements.

    Raises:
        ValueError: an edge names a node that does not exist, joins a node to itself or occurs twice; a width is not
            positive; a coordinate is not finite; there is no edge.
    """

    nodes: Float[ndarray, "n 2"]
    edges: Int64[ndarray, "e 2"]
    widths: Float[ndarray, " e"]

    def __post_init__(self) -> None:
        if self.nodes.ndim != 2 or self.nodes.shape[1] != 2 or self.edges.ndim != 2 or self.edges.shape[1] != 2:
            raise ValueError(f"nodes and edges need two columns, got {self.nodes.shape} and {self.edges.shape}")
        if self.widths.shape != (len(self.edges),) or len(self.edges) == 0:
            raise ValueError(f"need an edge and a width for each, got {len(self.edges)} and {self.widths.shape}")
        if self.edges.min() < 0 or self.edges.max() >= len(self.nodes):
            raise ValueError(f"edges name nodes 0..{len(self.nodes) - 1}, got {self.edges.min()}..{self.edges.max()}")
        if (self.edges[:, 0] == self.edges[:, 1]).any() or len(self._edge_of_pair) < len(self.edges):
            raise ValueError("an edge joins a node to itself or occurs twice")
        if not (np.isfinite(self.nodes).all() and np.isfinite(self.widths).all() and (self.widths > 0).all()):
            raise ValueError("coordinates and widths must be finite, and widths positive")

    @cached_property
    def lengths(self) -> Float[ndarray, " e"]:
        """Length of each edge in metres."""
        return np.asarray(np.linalg.norm(np.diff(self.nodes[self.edges], axis=1)[:, 0], axis=1))

    @property
    def length_m(self) -> float:
        """Metres of street, each piece counted once."""
        return float(self.lengths.sum())

    @property
    def block_m(self) -> float:
        """Side of a typical block in metres: ``min(2 A / L, median edge)``, with A the hull's area and L `length_m`.

        On an infinite square grid of spacing s there are L = 2 A / s metres of street, so both terms are s; on finite
        and on sparse graphs the smaller term keeps `area_km2` from claiming land that no street opens up.
        """
        hull = shapely.MultiPoint(self.nodes).convex_hull.area
        return float(min(2 * hull / self.length_m, np.median(self.lengths)))

    @property
    def area_km2(self) -> float:
        """Area of the town in km²: the convex hull of the nodes, widened by half a block (`block_m` / 2) all round."""
        return float(shapely.MultiPoint(self.nodes).convex_hull.buffer(self.block_m / 2).area / 1e6)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Smallest x, smallest y, largest x, largest y of the nodes, in metres."""
        (left, bottom), (right, top) = self.nodes.min(axis=0), self.nodes.max(axis=0)
        return float(left), float(bottom), float(right), float(top)

    @cached_property
    def neighbours(self) -> tuple[tuple[int, ...], ...]:
        """For each node, the nodes joined to it by an edge, counter-clockwise by heading, starting from -pi."""
        found: list[list[int]] = [[] for _ in self.nodes]
        for a, b in self.edges.tolist():
            found[a].append(b)
            found[b].append(a)
        return tuple(tuple(self._by_heading(node, others)) for node, others in enumerate(found))

    def _by_heading(self, node: int, others: Sequence[int]) -> list[int]:
        if not others:
            return []
        ray = self.nodes[list(others)] - self.nodes[node]
        return [others[i] for i in np.argsort(np.arctan2(ray[:, 1], ray[:, 0]), kind="stable")]

    @cached_property
    def degrees(self) -> Int64[ndarray, " n"]:
        """Number of edges at each node."""
        return np.bincount(self.edges.ravel(), minlength=len(self.nodes)).astype(np.int64)

    @cached_property
    def _edge_of_pair(self) -> dict[tuple[int, int], int]:
        return {(min(a, b), max(a, b)): e for e, (a, b) in enumerate(self.edges.tolist())}

    def edge_between(self, a: int, b: int) -> int | None:
        """Number of the edge that joins two nodes, in either direction; None where there is none."""
        return self._edge_of_pair.get((min(a, b), max(a, b)))
