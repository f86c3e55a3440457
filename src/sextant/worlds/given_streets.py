"""A street graph from the streets of a map."""

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

import networkx as nx
import numpy as np
import shapely
from jaxtyping import Float
from numpy import ndarray
from shapely import LineString

from sextant.errors import UserError
from sextant.worlds.street_graph import StreetGraph
from sextant.worlds.street_layouts import MAX_SIZE_M, MIN_EDGE_M, STREET_WIDTH_M
from sextant.worlds.street_repair import REPAIRS, join, prune, repair

#: lines that pass each other at less than this meet, and bends of less than this are straight
JOINED_M, STRAIGHT_M = 0.05, 1.0
#: a map less wide along x and y than the first makes no town; one of more pieces of street takes many minutes
SMALLEST_M, MOST_PIECES = 60.0, 3000


def given_streets(
    lines: Sequence[Float[ndarray, "n 2"]], widths: Sequence[float] | Float[ndarray, " s"] | None = None
) -> StreetGraph:
    """Streets along the centre lines of a map, which may cross, overlap, fall short of each other or be bent finely.

    1. Where lines cross or meet there is a junction. Dead ends under 25 m go.
    2. Between junctions, bends of under 1 m are straightened, and bends are at least 25 m apart.
    3. What still violates the rules of a town is repaired as for :func:`~sextant.worlds.traced_streets`: nodes under
       15 m from a street join it, edges under 25 m are contracted (of a roundabout or a dual carriageway one junction
       or street is left), and of two edges that diverge by under 40 degrees the longer starts where the shorter ends.
       What cannot be repaired is dropped, and the largest connected part is kept.

    A piece of street is as wide as the line nearest to its middle.

    Args:
        lines: metres, a row for each bend.
        widths: of the carriageway along each line, in metres; 8 m if None.

    Raises:
        UserError: no streets are left, or the map is not 60 m to 20 km wide or has more than 3,000 pieces of street.

    Example:
        >>> crossing = given_streets([np.array([[0.0, 0], [200, 0]]), np.array([[100.0, -80], [100, 80]])])
        >>> len(crossing.edges), crossing.length_m
        (4, 360.0)
    """
    if not lines or not all(np.ndim(line) == 2 and len(line) > 1 and np.isfinite(line).all() for line in lines):
        raise UserError(f"streets need at least one line of two points or more, all finite; got {len(lines)} lines")
    if widths is not None and len(widths) != len(lines):
        raise UserError(f"{len(widths)} widths are given for {len(lines)} streets")
    streets = f"{len(lines)} street{'' if len(lines) == 1 else 's'}"
    drawn = [LineString(line) for line in lines]
    extent = float(np.ptp(np.concatenate(lines), axis=0).max())
    if not SMALLEST_M <= extent <= MAX_SIZE_M:
        raise UserError(
            f"{streets} over {extent:,.1f} m can be no town: it must be {SMALLEST_M:g} m to "
            f"{MAX_SIZE_M / 1000:g} km wide"
        )
    town = _graph(_chains(drawn))
    if town.number_of_edges():
        repair(town, most=REPAIRS + town.number_of_edges())
        prune(town)
    if town.number_of_edges() == 0:
        raise UserError(f"{streets} over {extent:,.1f} m leave no street of {MIN_EDGE_M:g} m")
    number = {node: i for i, node in enumerate(sorted(town))}
    nodes = np.array([town.nodes[node]["at"] for node in number])
    edges = np.array(sorted(sorted((number[a], number[b])) for a, b in town.edges), np.int64)
    nearest = shapely.STRtree(drawn).nearest(shapely.points(nodes[edges].mean(axis=1)))
    wide = np.full(len(drawn), STREET_WIDTH_M) if widths is None else np.asarray(widths, float)
    return StreetGraph(nodes, edges, wide[nearest])


def _chains(lines: Sequence[LineString]) -> list[Float[ndarray, "n 2"]]:
    """Steps 1 and 2: the bends from one junction or end to the next, of all lines together."""
    parts = _merged(shapely.set_precision(shapely.MultiLineString(lines), JOINED_M))
    met = Counter(part.coords[k] for part in parts for k in (0, -1))
    kept = [part for part in parts if part.length >= MIN_EDGE_M or min(met[part.coords[k]] for k in (0, -1)) > 1]
    return [_thinned(np.asarray(part.simplify(STRAIGHT_M).coords)) for part in _merged(shapely.MultiLineString(kept))]


def _merged(lines: shapely.Geometry) -> list[LineString]:
    """Lines that meet at their ends alone, where there is a junction."""
    parts = shapely.get_parts(shapely.line_merge(shapely.unary_union(lines))).tolist()
    return [part for part in parts if isinstance(part, LineString) and not part.is_empty]


def _thinned(bends: Float[ndarray, "n 2"]) -> Float[ndarray, "k 2"]:
    """The ends, and every bend that is far enough from the one kept before it and from the end."""
    kept = [bends[0]]
    for bend in bends[1:-1]:
        if min(np.hypot(*(bend - other)) for other in (kept[-1], bends[-1])) >= MIN_EDGE_M:
            kept.append(bend)
    return np.array([*kept, bends[-1]])


def _graph(chains: Sequence[Float[ndarray, "n 2"]]) -> nx.Graph:
    """The chains as a graph under construction; see `street_repair` for its form."""
    pieces = sum(len(chain) - 1 for chain in chains)
    if pieces > MOST_PIECES:
        raise UserError(f"{pieces:,} pieces of street are too many: at most {MOST_PIECES:,} are possible")
    town: nx.Graph = nx.Graph()
    numbers: dict[tuple[float, ...], int] = {}
    for chain in chains:
        nodes = [numbers.setdefault(tuple(bend), len(numbers)) for bend in chain.tolist()]
        for node, bend in zip(nodes, chain, strict=True):
            town.add_node(node, at=bend)
        for a, b in pairwise(nodes):
            join(town, a, b, 1)
    return town
