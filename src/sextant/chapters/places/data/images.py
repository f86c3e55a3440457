"""Images of places, and where each was taken."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from sextant.chapters.places.data.image_rows import ImageRows
from sextant.chapters.places.data.tolerance import PlaceTolerance
from sextant.errors import UserError

#: queries, or images in memory, at a time; and pairs that may be proposed for these queries, of 24 bytes each
CHUNK, PROPOSED = 512, 2_000_000


def within_distance(
    queries: Float64[ndarray, "q 2"], references: Float64[ndarray, "r 2"], distance: float, *, strict: bool = False
) -> csr_array:
    r"""Pairs of positions at most ``distance`` apart, as a boolean matrix ``(q, r)``.

    Distances are :math:`d_{ij} = \lVert p_i - q_j \rVert`, compared in float64 exactly as written; the k-d tree only
    proposes candidates. Source of the tree: J. L. Bentley, "Multidimensional binary search trees used for associative
    searching", CACM 18(9), 1975.

    Args:
        queries: positions.
        references: positions.
        distance: in the unit of the positions.
        strict: less than ``distance`` instead of at most.

    Raises:
        ValueError: a position is not finite.
    """
    if not (np.isfinite(queries).all() and np.isfinite(references).all()):
        raise ValueError("positions must be finite")
    if not len(queries) or not len(references):
        return csr_array((len(queries), len(references)), dtype=bool)
    tree = cKDTree(references)
    reach = distance * (1 + 1e-9) + 1e-9
    columns, counts = [], []
    chunk = max(1, min(CHUNK, PROPOSED // len(references)))
    for start in range(0, len(queries), chunk):
        part = queries[start : start + chunk]
        row, column = _proposed(tree, part, reach)
        apart = np.hypot(*(part[row] - references[column]).T)
        near = apart < distance if strict else apart <= distance
        columns.append(column[near].astype(np.int32))
        counts.append(np.bincount(row[near], minlength=len(part)))
    return _matrix(np.concatenate(columns), np.concatenate(counts), len(references))


def _proposed(tree: cKDTree, part: Float64[ndarray, "k 2"], reach: float) -> tuple[ndarray, ndarray]:
    """Pairs that may be near, in row order: those proposed by the tree, or all pairs if these would be many."""
    if 20 * tree.query_ball_point(part, reach, return_length=True).sum() > len(part) * tree.n:
        row, column = np.indices((len(part), tree.n)).reshape(2, -1)
        return row, column
    found = cKDTree(part).sparse_distance_matrix(tree, reach, output_type="ndarray")
    order = np.lexsort([found["j"], found["i"]])
    return found["i"][order], found["j"][order]


def within_frames(
    queries: Int64[ndarray, "q"], references: Int64[ndarray, "r"], distance: float, *, strict: bool = False
) -> csr_array:
    """Pairs of frame numbers at most ``distance`` apart, or less than that if ``strict``; boolean, ``(q, r)``."""
    order = np.argsort(references, kind="stable")
    ordered = references[order]
    begin = np.searchsorted(ordered, queries - distance, "right" if strict else "left")
    end = np.searchsorted(ordered, queries + distance, "left" if strict else "right")
    counts = np.maximum(end - begin, 0)
    offset = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    matrix = _matrix(order[np.repeat(begin, counts) + offset].astype(np.int32), counts, len(references))
    matrix.sort_indices()
    return matrix


def keep_pairs(matrix: csr_array, keep: ndarray) -> csr_array:
    """The pairs of a matrix for which ``keep``, in storage order, is true."""
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    return _matrix(matrix.indices[keep], np.bincount(rows[keep], minlength=matrix.shape[0]), matrix.shape[1])


def pairs_of(matrix: csr_array, row: int) -> Int64[ndarray, "k"]:
    """Columns of the pairs of one row."""
    return np.asarray(matrix.indices[matrix.indptr[row] : matrix.indptr[row + 1]], np.int64)


def heading_difference_deg(a: Float64[ndarray, "n"], b: Float64[ndarray, "n"]) -> Float64[ndarray, "n"]:
    """Angle between headings in degrees, 0 to 180, modulo full turns."""
    return np.asarray(np.abs((a - b + 180) % 360 - 180))


def _matrix(columns: ndarray, counts: ndarray, width: int) -> csr_array:
    starts = np.concatenate([[0], np.cumsum(counts)])
    if len(columns) < 2**31:  # SciPy keeps 32-bit indices only if both arrays have them
        starts = starts.astype(np.int32)
    return csr_array((np.ones(len(columns), bool), columns, starts), shape=(len(counts), width))


Split = Literal["train", "val", "test"]
SPLITS: tuple[Split, ...] = get_args(Split)


FLAT_SD = 10.0
STILL_DIFFERENCE = 3.0


def flat_frames(images: ImageRows) -> Bool[ndarray, "n"]:
    """Whether the intensities of each image have a standard deviation below :data:`FLAT_SD`.

    An image is *flat* if the standard deviation of its intensities (the mean of its channels, 0 to 255) is below
    :data:`FLAT_SD`. The threshold lies in the gap of the training frames 0 to 1,599 of Nordland at 64 x 32 pixels:
    summer has 60 frames below 8 (dark tunnels), none from 8 to 14 and 1,540 above; winter has 35 below 10.

    An image is *still* if its mean absolute difference from the previous image of its traverse is below
    :data:`STILL_DIFFERENCE`. Of the 1,599 steps between these frames, about 250 are below 2 and 1,310 above 8; few lie
    between.
    """
    parts = [_grey(images, np.arange(start, min(start + CHUNK, len(images)))) for start in range(0, len(images), CHUNK)]
    return np.concatenate([part.std((1, 2)) < FLAT_SD for part in parts] or [np.zeros(0, bool)])


def still_frames(images: ImageRows, traverse: Int64[ndarray, "n"], frame: Int64[ndarray, "n"]) -> Bool[ndarray, "n"]:
    """Whether each image is *still*; False if the previous frame of its traverse is missing."""
    order = np.lexsort([frame, traverse])
    before, after = order[:-1], order[1:]
    follows = (traverse[before] == traverse[after]) & (frame[before] + 1 == frame[after])
    before, after = before[follows], after[follows]
    still = np.zeros(len(images), bool)
    for start in range(0, len(after), CHUNK):
        part = slice(start, start + CHUNK)
        difference = np.abs(_grey(images, after[part]) - _grey(images, before[part])).mean((1, 2))
        still[after[part]] = difference < STILL_DIFFERENCE
    return still


def _grey(images: ImageRows, rows: ndarray) -> Float32[ndarray, "k h w"]:
    return np.asarray(images[rows].mean(-1, dtype=np.float32))


@dataclass(frozen=True, eq=False)
class PlaceImages:
    """Images of one split with the place of each.

    A *traverse* is a set of images under one condition, mostly a drive. Places are known by position, by frame number
    along aligned traverses, or by both.

    Attributes:
        images: bytes ``(n, h, w, c)``, read when indexed.
        traverse: traverse of each image.
        conditions: a name for each traverse.
        frame: number of each image along its traverse.
        names: a name for each image: its file, if it has one.
        position_m: x and y in metres, or None.
        heading_deg: viewing direction in degrees, from any origin and in either sense as long as both are the same for
            all; nan where unknown, or None.
        aligned: equal frames of two traverses show one place.
        drives: the frames of a traverse follow one another, as sequence matching assumes.
        skipped: files left out because they cannot be used, each with the reason.
        copies: conditions whose images are altered copies of another's: they have their own recall, but are left out of
            that of pairs.
        content: whether each image is flat and whether it is still; None to compute both from the pixels.
    """

    images: ImageRows
    traverse: Int64[ndarray, "n"]
    conditions: tuple[str, ...]
    frame: Int64[ndarray, "n"]
    names: tuple[str, ...]
    position_m: Float64[ndarray, "n 2"] | None = None
    heading_deg: Float64[ndarray, "n"] | None = None
    aligned: bool = True
    drives: bool = True
    skipped: tuple[str, ...] = ()
    copies: tuple[str, ...] = ()
    content: tuple[Bool[ndarray, "n"], Bool[ndarray, "n"]] | None = None

    def __post_init__(self) -> None:
        columns = (self.traverse, self.frame, self.names, self.position_m, self.heading_deg)
        lengths = {len(self.images), *(len(column) for column in columns if column is not None)}
        if len(lengths) > 1:
            raise ValueError(f"columns of different lengths: {sorted(lengths)}")
        if not self.aligned and self.position_m is None:
            raise ValueError("places need positions, or frames that are aligned")

    def __len__(self) -> int:
        return len(self.images)

    def rows_of(self, condition: str) -> Int64[ndarray, "k"]:
        """Indices of the images of one traverse, in the order of their frames.

        Raises:
            UserError: there is no such condition.
        """
        if condition not in self.conditions:
            raise UserError(
                f"there is no condition {condition!r}; there are {', '.join(self.conditions)}", "Choose one of these."
            )
        rows = np.flatnonzero(self.traverse == self.conditions.index(condition))
        return rows[np.argsort(self.frame[rows], kind="stable")]

    def select(self, rows: Int64[ndarray, "k"]) -> "PlaceImages":
        """A subset of the images; the names of all conditions are kept."""

        def part(column: ndarray | None) -> ndarray | None:
            return None if column is None else column[rows]

        return replace(
            self,
            images=self.images.select(rows),
            traverse=self.traverse[rows],
            frame=self.frame[rows],
            names=tuple(self.names[row] for row in rows),
            position_m=part(self.position_m),
            heading_deg=part(self.heading_deg),
            content=None if self.content is None else (self.content[0][rows], self.content[1][rows]),
        )

    def only_conditions(self, names: Sequence[str]) -> "PlaceImages":
        """The traverses of these conditions, renumbered in this order.

        Raises:
            UserError: there is no such condition.
        """
        rows = np.concatenate([self.rows_of(name) for name in names])
        part = self.select(rows)
        traverse = np.repeat(np.arange(len(names)), [len(self.rows_of(name)) for name in names])
        return replace(part, traverse=traverse, conditions=tuple(names))

    def positives(
        self, queries: Int64[ndarray, "q"], references: Int64[ndarray, "r"], tolerance: PlaceTolerance
    ) -> "csr_array":
        """Which images show the same place: a sparse boolean matrix ``(q, r)`` by the positive tolerance.

        An image is not a positive of itself. A query without positives has an empty row: count these by
        ``np.diff(matrix.indptr) == 0``. The columns of a row are sorted; memory grows with the number of positives.

        Args:
            queries: indices of images.
            references: indices of images.
            tolerance: within which images show the same place.

        Raises:
            UserError: places are not known in the tolerance's unit, or headings are unknown.
        """
        pairs = self._within(queries, references, tolerance, tolerance.positive, strict=False)
        query, reference = _rows_and_columns(pairs, queries, references)
        keep = query != reference
        if tolerance.heading_deg is not None:
            heading = self.heading_deg
            if heading is None or np.isnan(heading[queries]).any() or np.isnan(heading[references]).any():
                raise UserError(
                    f"tolerance.heading_deg={tolerance.heading_deg:g}, but headings of these images are not known",
                    "tolerance.heading_deg=null",
                )
            angle = heading_difference_deg(heading[query], heading[reference])
            keep &= angle <= tolerance.heading_deg
        return keep_pairs(pairs, keep)

    def not_negatives(
        self, queries: Int64[ndarray, "q"], references: Int64[ndarray, "r"], tolerance: PlaceTolerance
    ) -> "csr_array":
        """Pairs within the negative tolerance, whatever their headings: positives, the ring, and the image itself.

        All other pairs are negatives; of the pairs here, those that are not :meth:`positives` are ignored.
        """
        return self._within(queries, references, tolerance, tolerance.negative, strict=True)

    def _within(
        self, queries: ndarray, references: ndarray, tolerance: PlaceTolerance, distance: float, *, strict: bool
    ) -> "csr_array":
        if tolerance.unit == "frames":
            if not self.aligned:
                raise UserError(
                    "tolerance.unit=frames, but these traverses are not aligned: places are known by position",
                    "For example tolerance.unit=m tolerance.positive=5 tolerance.negative=25",
                )
            return within_frames(self.frame[queries], self.frame[references], distance, strict=strict)
        if self.position_m is None:
            raise UserError(
                "tolerance.unit=m, but positions of these images are not known: places are known by frame",
                "For example tolerance.unit=frames tolerance.positive=1 tolerance.negative=10",
            )
        return within_distance(self.position_m[queries], self.position_m[references], distance, strict=strict)

    @property
    def originals(self) -> tuple[str, ...]:
        """Conditions that are not copies."""
        return tuple(name for name in self.conditions if name not in self.copies)

    @cached_property
    def flat(self) -> Bool[ndarray, "n"]:
        """Images without content, such as tunnels; see :func:`~sextant.chapters.places.data.images.flat_frames`."""
        return flat_frames(self.images) if self.content is None else self.content[0]

    @cached_property
    def still(self) -> Bool[ndarray, "n"]:
        """Images like the one before, as at a stop; see :func:`~sextant.chapters.places.data.images.still_frames`."""
        return still_frames(self.images, self.traverse, self.frame) if self.content is None else self.content[1]


def _rows_and_columns(pairs: "csr_array", queries: ndarray, references: ndarray) -> tuple[ndarray, ndarray]:
    """Indices of the images of every stored pair."""
    rows = np.repeat(np.arange(pairs.shape[0]), np.diff(pairs.indptr))
    return np.asarray(queries)[rows], np.asarray(references)[pairs.indices]
