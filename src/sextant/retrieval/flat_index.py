"""An index of descriptors with exhaustive search: exact, and fast enough for one camera and a city.

One query reads ``4 n d`` bytes once, 88 MB for 172,000 descriptors of 128 values. This is the cost of a matrix-vector
product; selecting the best costs little in comparison; see :mod:`sextant.retrieval.nearest`.

On disk, an index is a folder with ``descriptors.npy``, which is memory-mapped, and ``index.json``.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from sextant.array_folder import FolderFormat
from sextant.atomic_files import hash_file, write_atomically
from sextant.retrieval.nearest import Neighbours, PreparedReferences, Similarity, prepare_references, search_prepared

DESCRIPTORS, HEADER = "descriptors.npy", "index.json"
KIND = FolderFormat("an index", "sextant.flat_index", 1, HEADER)


class FlatIndex:
    """Exact search by cosine similarity, of rows rounded to float32 after scaling, or Euclidean distance.

    Finiteness is checked and norms are computed here, once, and not for each query.

    Args:
        descriptors: one per row. For cosine similarity, a copy scaled to norm one is kept; for Euclidean distance, the
            array itself, which must not be changed afterwards.
        similarity: ``cosine`` or ``euclidean``.
        names: names of the rows, such as files; none by default.

    Raises:
        ValueError: as :func:`~sextant.retrieval.nearest.prepare_references`, or there are not as many names as rows.

    Example:
        >>> index = FlatIndex(np.array([[1, 0], [0, 1], [1, 1]], np.float32))
        >>> found = index.search(np.array([[2, 0.1]], np.float32), 2)
        >>> found.indices
        array([[0, 2]])
    """

    def __init__(
        self,
        descriptors: Float32[ndarray, "n d"],
        similarity: Similarity = "cosine",
        names: Sequence[str] | None = None,
    ):
        self._take(prepare_references(descriptors, similarity), names)

    @classmethod
    def joined(cls, parts: Sequence[Self], names: Sequence[str] | None = None) -> Self:
        """Concatenate the rows of several indexes with the same similarity, as they are.

        Raises:
            ValueError: there are none, or their dimensions or similarities differ.
        """
        if len({part.similarity for part in parts}) != 1:
            raise ValueError("need indexes of one similarity")
        rows = np.concatenate([part.references.rows for part in parts])
        index = cls.__new__(cls)
        index._take(prepare_references(rows, parts[0].similarity, unit=True), names)
        return index

    def _take(self, references: PreparedReferences, names: Sequence[str] | None) -> None:
        if names is not None and len(names) != len(references.rows):
            raise ValueError(f"need a name for each of the {len(references.rows)} descriptors; got {len(names)}")
        self.references = references
        self.names = None if names is None else tuple(names)

    def __len__(self) -> int:
        return len(self.references.rows)

    @property
    def dimension(self) -> int:
        """Number of values in a descriptor."""
        return int(self.references.rows.shape[1])

    @property
    def similarity(self) -> Similarity:
        """The similarity by which descriptors are compared."""
        return self.references.similarity

    def search(self, queries: Float32[ndarray, "m d"], k: int = 1) -> Neighbours:
        """The k most similar descriptors for every query, best first; ties go to the lower index.

        The neighbours do not depend on how queries are grouped into calls. Memory besides the result: about 64 MiB.

        Args:
            queries: one descriptor per row.
            k: number of neighbours, in [1, n].

        Returns:
            ``values`` (cosine similarities, or Euclidean distances) and ``indices``, both (m, k).

        Raises:
            ValueError: k is out of range, the dimensions differ, or a query is not finite or, for Euclidean distance,
                too large for float32.
        """
        return search_prepared(self.references, queries, k)

    def save(self, folder: Path) -> None:
        """Write the index into a folder, which is created if needed; an existing index is replaced.

        Raises:
            OSError: the folder cannot be written.
        """
        write_atomically(folder / DESCRIPTORS, lambda file: np.save(file, self.references.rows, allow_pickle=False))
        # written last: without it, or with one that describes other descriptors, the folder does not count as an index
        header = {
            "similarity": self.similarity,
            "count": len(self),
            "dimension": self.dimension,
            "sha256": hash_file(folder / DESCRIPTORS),
            "names": None if self.names is None else list(self.names),
        }
        KIND.write_header(folder, header)

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Open a saved index; the descriptors are memory-mapped, read-only.

        Raises:
            UserError: the folder does not exist, or holds no index, one of another version, or a damaged one.
        """
        header = _header(folder)
        path = folder / DESCRIPTORS
        rows = KIND.open_array(folder, path, "r", sha256=header["sha256"])
        if rows.dtype != np.float32 or rows.shape != (header["count"], header["dimension"]):
            told = f"{header['count']} x {header['dimension']}"
            raise KIND.damaged(
                folder, f"{path.name} holds {rows.dtype} {rows.shape}, but {HEADER} states {told} float32"
            )
        index = cls.__new__(cls)
        try:
            index._take(prepare_references(rows, header["similarity"], unit=True), header["names"])
        except ValueError as error:
            raise KIND.damaged(folder, str(error)) from error
        return index


def _header(folder: Path) -> dict[str, Any]:
    header = KIND.read_header(folder)
    names = header.get("names", ())
    good = header.get("similarity") in ("cosine", "euclidean") and all(
        type(header.get(key)) is kind for key, kind in (("count", int), ("dimension", int), ("sha256", str))
    )
    if not good or not (names is None or (isinstance(names, list) and all(isinstance(name, str) for name in names))):
        raise KIND.damaged(folder, f"{HEADER} lacks keys, or they have values of the wrong kind")
    return header
