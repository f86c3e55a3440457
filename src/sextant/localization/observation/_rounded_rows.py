r"""Descriptors rounded to eight bits, to compare a whole map with an image by reading a quarter of the memory.

Row i is :math:`y_i \approx s_i b_i`, with whole numbers :math:`b_i` from -127 to 127 and :math:`s_i = \max_j |y_{ij}| /
127`. A product with a vector z is then off by at most :math:`\tfrac12 s_i \lVert z \rVert_1`, and by
:math:`s_i \lVert z \rVert_2 / \sqrt{12}` if the errors of rounding are independent.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Float32, Int8
from numpy import ndarray

from sextant.localization.observation import _cache_kernels as machine

#: rows that are rounded, or converted back, at a time
BLOCK = 8192
LARGEST = 127


@dataclass(frozen=True)
class RoundedRows:
    """Rows of numbers in eight bits each.

    Attributes:
        values: b.
        scales: s.

    Example:
        >>> rows = RoundedRows.of(np.array([[3.0, 4.0], [0.0, 1.0]], np.float32))
        >>> rows.products(np.array([[1.0, 1.0]], np.float32)).round(2)
        array([[6.99, 1.  ]], dtype=float32)
    """

    values: Int8[ndarray, "n d"]
    scales: Float32[ndarray, " n"]

    @classmethod
    def of(cls, rows: Float32[ndarray, "n d"]) -> Self:
        """Round the rows, which may be a mapped file; all values must be finite."""
        values, scales = np.empty(rows.shape, np.int8), np.empty(len(rows), np.float32)
        for start in range(0, len(rows), BLOCK):
            some = slice(start, start + BLOCK)
            part = np.asarray(rows[some], np.float32)
            scales[some] = np.maximum(np.abs(part).max(axis=1), np.finfo(np.float32).tiny * LARGEST) / LARGEST
            values[some] = np.rint(part / scales[some, None])
        return cls(values, scales)

    def products(self, vectors: Float32[ndarray, "r d"]) -> Float32[ndarray, "r n"]:
        """The products of r vectors with all rows."""
        found = np.empty((len(vectors), len(self.values)), np.float32)
        if len(vectors) == 1:
            machine.rounded_products(self.values, self.scales, vectors[0], found[0])
            return found
        for start in range(0, len(self.values), BLOCK):
            some = slice(start, start + BLOCK)
            with np.errstate(invalid="ignore", over="ignore"):  # a descriptor with nan gives only nan
                found[:, some] = vectors @ self.values[some].astype(np.float32).T * self.scales[some]
        return found
