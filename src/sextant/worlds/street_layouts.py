"""Layouts of invented towns: a grid of streets, and an older town that grew.

Both are a rectangular net whose corners are moved and some of whose streets are left out. Corners are moved only so far
that every block stays convex with angles of 40 to 140 degrees and every street at least 25 m long (0.6 of the spacing
on a finer net), which makes the graph plane by construction; streets are left out only where all junctions stay
connected and none becomes a dead end.
"""

import numpy as np
from jaxtyping import Bool, Float, Int64
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree

from sextant.errors import UserError
from sextant.worlds.street_graph import StreetGraph

STREET_WIDTH_M = 8.0
AVENUE_WIDTH_M = 12.0
#: Number of blocks from one avenue to the next.
AVENUE_EVERY = 5
MIN_ANGLE_RAD = np.deg2rad(40.0)
MIN_EDGE_M = 25.0
MIN_SPACING_M = 40.0
MAX_SIZE_M = 20_000.0
MAX_JUNCTIONS = 100_000


def grid_streets(columns: int, rows: int, spacing_m: float, seed: int = 0, jitter_m: float = 0.0) -> StreetGraph:
    """Streets along a grid of ``columns × rows`` blocks, each corner moved by up to ``jitter_m`` in x and in y.

    Every fifth street is an avenue 12 m wide; the others are 8 m wide. The south-west corner is the origin. Node
    ``j (columns + 1) + i`` is column ``i`` of row ``j``.

    Raises:
        UserError: no block, blocks under 40 m, more than 100,000 junctions, a town over 20 km, or jitter over a fifth
            of the spacing.

    >>> streets = grid_streets(2, 1, spacing_m=100.0)  # two blocks side by side
    >>> len(streets.nodes), len(streets.edges), streets.length_m
    (6, 7, 700.0)
    """
    check_range("streets.columns", columns, 1, MAX_JUNCTIONS // 2)
    check_range("streets.rows", rows, 1, MAX_JUNCTIONS // 2)
    check_range("streets.spacing_m", spacing_m, MIN_SPACING_M, MAX_SIZE_M)
    check_range("streets.jitter_m", jitter_m, 0.0, spacing_m / 5)
    _check_total(columns, rows, spacing_m)
    move = np.random.default_rng(seed).uniform(-jitter_m, jitter_m, (rows + 1, columns + 1, 2))
    edges, widths = _net(columns, rows)
    return StreetGraph(_settle(_corners(columns, rows) * spacing_m, move, spacing_m).reshape(-1, 2), edges, widths)


def irregular_streets(size_m: float, block_m: float, seed: int, drop: float = 0.08) -> StreetGraph:
    """Streets of a town that grew, over ``size_m × size_m``: bending streets, blocks of many shapes, T-junctions.

    A net of ``round(size_m / block_m) - 1`` blocks a side, half a block from the bounds, is bent by a smooth random
    field (waves of 5 to 16 blocks); its corners are moved by up to 0.15 of a block, those at the border inwards only;
    and a share ``drop`` of the streets is left out at random, avenues (every fifth street, 12 m) excepted.

    Raises:
        UserError: ``size_m`` is not in [80, 20000], ``block_m`` not in [40, size_m / 2], ``drop`` not in [0, 0.3], or
            there would be more than 100,000 junctions.

    >>> town = irregular_streets(800.0, block_m=100.0, seed=1)
    >>> len(town.nodes), len(town.edges)  # 8 x 8 corners, as a net with 112 streets of which nine were left out
    (64, 103)
    """
    check_range("streets.size_m", size_m, 2 * MIN_SPACING_M, MAX_SIZE_M)
    check_range("streets.block_m", block_m, MIN_SPACING_M, size_m / 2)
    check_range("streets.drop", drop, 0.0, 0.3)
    blocks = round(size_m / block_m) - 1
    spacing = size_m / (blocks + 1)
    _check_total(blocks, blocks, spacing)
    rng = np.random.default_rng(seed)
    corners = _corners(blocks, blocks)
    move = spacing * _inwards(_bend(corners, rng) + rng.uniform(-0.15, 0.15, corners.shape))
    nodes = _settle((corners + 0.5) * spacing, move, spacing).reshape(-1, 2)
    edges, widths = _net(blocks, blocks)
    keep = _left_after_dropping(edges, len(nodes), drop, widths < AVENUE_WIDTH_M, rng)
    return StreetGraph(nodes, edges[keep], widths[keep])


def check_range(key: str, value: float, low: float, high: float) -> None:
    """Raise a `UserError` that names ``key`` unless ``low <= value <= high``."""
    if not low <= value <= high:  # also false for nan
        example = low if not value > high else high
        raise UserError(f"{key}={value:g} is out of range: it must be in [{low:g}, {high:g}]", f"Try {key}={example:g}")


def _check_total(columns: int, rows: int, spacing_m: float) -> None:
    if (columns + 1) * (rows + 1) > MAX_JUNCTIONS or max(columns, rows) * spacing_m > MAX_SIZE_M * (1 + 1e-9):
        raise UserError(
            f"streets: {columns} x {rows} blocks of {spacing_m:g} m are too many: at most {MAX_JUNCTIONS:,} junctions "
            f"and {MAX_SIZE_M:g} m per side",
            "Use a smaller streets.size_m (or columns and rows), or larger blocks",
        )


def _corners(columns: int, rows: int) -> Float[ndarray, "rows columns 2"]:
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0))
    return np.stack([x, y], axis=-1)


def _net(columns: int, rows: int) -> tuple[Int64[ndarray, "e 2"], Float[ndarray, " e"]]:
    """Edges of the net and their widths; streets on the boundary of the town are not avenues."""
    number = np.arange((rows + 1) * (columns + 1), dtype=np.int64).reshape(rows + 1, columns + 1)
    along_x = np.stack([number[:, :-1], number[:, 1:]], axis=-1)  # (rows + 1, columns, 2)
    along_y = np.stack([number[:-1], number[1:]], axis=-1)  # (rows, columns + 1, 2)
    row_is_avenue = np.arange(rows + 1) % AVENUE_EVERY == AVENUE_EVERY // 2
    column_is_avenue = np.arange(columns + 1) % AVENUE_EVERY == AVENUE_EVERY // 2
    avenue = np.concatenate([np.repeat(row_is_avenue, columns), np.tile(column_is_avenue, rows)])
    edges = np.concatenate([along_x.reshape(-1, 2), along_y.reshape(-1, 2)])
    return edges, np.where(avenue, AVENUE_WIDTH_M, STREET_WIDTH_M)


def _bend(
    corners: Float[ndarray, "rows columns 2"], rng: np.random.Generator, waves: int = 8
) -> Float[ndarray, "rows columns 2"]:
    """A smooth random displacement in blocks: a sum of plane waves, with amplitudes proportional to their lengths."""
    length = rng.uniform(5.0, 16.0, waves)
    direction = rng.uniform(0, 2 * np.pi, waves)
    wave = 2 * np.pi / length * np.stack([np.cos(direction), np.sin(direction)])  # (2, waves)
    phase = corners @ wave + rng.uniform(0, 2 * np.pi, waves)  # (rows, columns, waves)
    return np.asarray(np.sin(phase) @ (0.025 * length[:, None] * rng.normal(size=(waves, 2))))


def _inwards(move: Float[ndarray, "rows columns 2"]) -> Float[ndarray, "rows columns 2"]:
    """The moves in blocks; those at the border are turned inwards and kept below half a block."""
    turned, inwards = move.copy(), np.minimum(np.abs(move), 0.45)
    turned[:, 0, 0], turned[:, -1, 0] = inwards[:, 0, 0], -inwards[:, -1, 0]
    turned[0, :, 1], turned[-1, :, 1] = inwards[0, :, 1], -inwards[-1, :, 1]
    return turned


def _settle(
    regular: Float[ndarray, "rows columns 2"], move: Float[ndarray, "rows columns 2"], spacing_m: float
) -> Float[ndarray, "rows columns 2"]:
    """``regular + move``, with the moves around every offending block halved until no block offends."""
    move = move.copy()
    for _ in range(64):
        bad = _offending(regular + move, min(MIN_EDGE_M, 0.6 * spacing_m))
        if not bad.any():
            return np.asarray(regular + move)
        padded = np.pad(bad, 1)
        move[padded[:-1, :-1] | padded[1:, :-1] | padded[:-1, 1:] | padded[1:, 1:]] *= 0.5
    return np.asarray(regular)  # not reached: the moves have shrunk by a factor of 2**-64


def _offending(corners: Float[ndarray, "rows columns 2"], min_edge_m: float) -> Bool[ndarray, "rows-1 columns-1"]:
    """Blocks with an angle outside 40 to 140 degrees (so all that are not convex) or a side that is too short."""
    loop = np.stack([corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]], axis=2)  # (r, c, 4, 2)
    ahead = np.roll(loop, -1, axis=2) - loop
    behind = np.roll(loop, 1, axis=2) - loop
    cross = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]
    angle = np.arctan2(cross, (ahead * behind).sum(axis=-1))
    sharp = (angle < MIN_ANGLE_RAD) | (angle > np.pi - MIN_ANGLE_RAD)
    return np.asarray((sharp | (np.linalg.norm(ahead, axis=-1) < min_edge_m)).any(axis=-1))


def _left_after_dropping(
    edges: Int64[ndarray, "e 2"], nodes: int, share: float, may_go: Bool[ndarray, " e"], rng: np.random.Generator
) -> Bool[ndarray, " e"]:
    """Which edges remain when ``share`` of them is dropped at random, keeping a random spanning tree and degree 2."""
    weight = coo_array((rng.uniform(1, 2, len(edges)), (edges[:, 0], edges[:, 1])), shape=(nodes, nodes))
    tree = minimum_spanning_tree(weight.tocsr()).tocoo()
    in_tree = set(zip(tree.row.tolist(), tree.col.tolist(), strict=True))
    degree = np.bincount(edges.ravel(), minlength=nodes)
    keep = np.ones(len(edges), bool)
    left = round(share * len(edges))
    for e in rng.permutation(np.flatnonzero(may_go)):
        a, b = edges[e].tolist()
        if left == 0:
            break
        if (a, b) not in in_tree and degree[a] > 2 and degree[b] > 2:
            keep[e] = False
            degree[[a, b]] -= 1
            left -= 1
    return keep
