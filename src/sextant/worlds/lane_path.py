"""The line that a careful driver or walker follows: right of the streets' centre lines, with rounded corners."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int64
from numpy import ndarray

from sextant.worlds.street_graph import StreetGraph
from sextant.worlds.tours import check_nodes

SPACING_M = 0.5
#: A corner starts at most this share of an edge before its end, so that the corners at the two ends never meet.
CORNER_SHARE = 0.45
MIN_CORNER_M = 5.0
U_TURN_RAD = np.deg2rad(170.0)


@dataclass(frozen=True, eq=False)
class LanePath:
    """A smooth line along streets, sampled about every half metre.

    Attributes:
        positions: x, y in metres.
        headings: direction of the tangent in radians, unwrapped.
        curvatures: in 1/m, positive to the left.
        arc_m: arc length from the start; starts at 0 and increases.
        edges: the edge that each sample belongs to.
        stops: samples at which a driver would stop before each junction (a node with three streets or more).
    """

    positions: Float[ndarray, "n 2"]
    headings: Float[ndarray, " n"]
    curvatures: Float[ndarray, " n"]
    arc_m: Float[ndarray, " n"]
    edges: Int64[ndarray, " n"]
    stops: Int64[ndarray, " k"]


def lane_path(
    graph: StreetGraph, nodes: Sequence[int], *, share: float, beyond_m: float = 0.0, radius_m: float = 7.0
) -> LanePath:
    """The line through ``nodes``, ``share × width + beyond_m`` to the right of the centre of each street.

    A corner that turns by φ is a cubic close to an arc of ``radius_m``; it starts ``t = (radius ± offset)
    tan(φ/2)`` metres before the node (plus for a right turn), at least 5 m and at most 0.45 of the shorter edge. Where
    that is too short for a right turn, the line moves towards the centre there, so that it never doubles back.

    Raises:
        UserError: the nodes do not form a route through the graph; see `check_nodes`.
    """
    edges = np.array(check_nodes(graph, nodes))
    start, stop = graph.nodes[list(nodes[:-1])], graph.nodes[list(nodes[1:])]
    along = (stop - start) / graph.lengths[edges, None]
    right = np.stack([along[:, 1], -along[:, 0]], axis=1)
    offset = share * graph.widths[edges] + beyond_m
    trim, inner = _corners(along, graph.lengths[edges], offset, radius_m)
    after, before = np.r_[0.0, trim], np.r_[trim, 0.0]  # metres cut off each edge at its start and its end
    first = start + after[:, None] * along + np.minimum(offset, np.r_[np.inf, inner])[:, None] * right
    last = stop - before[:, None] * along + np.minimum(offset, np.r_[inner, np.inf])[:, None] * right
    return _sampled(graph, nodes, edges, first, last)


def _corners(
    along: Float[ndarray, "e 2"], length: Float[ndarray, " e"], offset: Float[ndarray, " e"], radius_m: float
) -> tuple[Float[ndarray, " e-1"], Float[ndarray, " e-1"]]:
    """For each node between two edges, where the corner starts and the largest offset that fits."""
    u, v = along[:-1], along[1:]
    turn = np.arctan2(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0], (u * v).sum(axis=1))  # left is positive
    back = np.abs(turn) > U_TURN_RAD
    tangent = np.tan(np.minimum(np.abs(turn), U_TURN_RAD) / 2)
    widest = np.maximum(offset[:-1], offset[1:])
    wanted = np.maximum(radius_m + np.where(turn < 0, widest, -widest), 0.0) * tangent
    room = CORNER_SHARE * np.minimum(length[:-1], length[1:])
    trim = np.minimum(np.maximum(np.where(back, 0.0, wanted), MIN_CORNER_M), room)
    inner = np.where((turn < 0) & ~back, 0.6 * trim / np.maximum(tangent, 1e-9), np.inf)
    return trim, inner


def _sampled(
    graph: StreetGraph,
    nodes: Sequence[int],
    edges: Int64[ndarray, " e"],
    first: Float[ndarray, "e 2"],
    last: Float[ndarray, "e 2"],
) -> LanePath:
    """Straight lines from ``first`` to ``last`` along each edge, joined by cubics."""
    unit = (last - first) / np.linalg.norm(last - first, axis=1, keepdims=True)
    pieces, owners, stops, count = [], [], [], 0
    for i, edge in enumerate(edges):
        line = _line(first[i], last[i])
        pieces.append(line)
        owners.append(np.full(len(line), edge))
        count += len(line)
        if i + 1 < len(edges):
            if graph.degrees[nodes[i + 1]] > 2:
                stops.append(count)  # the first sample of the corner
            curve = _cubic(last[i], unit[i], first[i + 1], unit[i + 1])
            pieces.append(curve)
            owners.append(np.repeat([edge, edges[i + 1]], [len(curve) // 2, len(curve) - len(curve) // 2]))
            count += len(curve)
    positions = np.concatenate([*pieces, last[-1:]])
    step = np.diff(positions, axis=0)
    arc = np.r_[0.0, np.cumsum(np.linalg.norm(step, axis=1))]
    chord = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    heading = np.asarray(np.interp(arc, (arc[1:] + arc[:-1]) / 2, chord))
    return LanePath(
        positions,
        heading,
        np.asarray(np.gradient(heading, arc)),
        arc,
        np.concatenate([*owners, edges[-1:]]).astype(np.int64),
        np.array(stops, np.int64),
    )


def _line(start: Float[ndarray, "2"], stop: Float[ndarray, "2"]) -> Float[ndarray, "k 2"]:
    count = max(1, round(float(np.linalg.norm(stop - start)) / SPACING_M))
    return np.asarray(start + np.arange(count)[:, None] / count * (stop - start))


def _cubic(
    start: Float[ndarray, "2"], leaving: Float[ndarray, "2"], stop: Float[ndarray, "2"], arriving: Float[ndarray, "2"]
) -> Float[ndarray, "k 2"]:
    """Bézier curve between two tangents, without its end point; close to an arc where one fits.

    The handles are ``4/3 tan(φ/4) R`` with ``R = chord / (2 sin(φ/2))``, a third of the chord where φ is 0.
    """
    turn = abs(np.arctan2(leaving[0] * arriving[1] - leaving[1] * arriving[0], leaving @ arriving))
    chord = float(np.linalg.norm(stop - start))
    handle = chord * (2 / 3 * np.tan(turn / 4) / np.sin(turn / 2) if turn > 1e-6 else 1 / 3)
    control = np.stack([start, start + handle * leaving, stop - handle * arriving, stop])
    length = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(control))
    count = max(4, round((length + chord) / 2 / SPACING_M))
    t = np.arange(count)[:, None] / count
    return np.asarray(
        (1 - t) ** 3 * control[0]
        + 3 * (1 - t) ** 2 * t * control[1]
        + 3 * (1 - t) * t**2 * control[2]
        + t**3 * control[3]
    )
