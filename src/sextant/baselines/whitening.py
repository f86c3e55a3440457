"""Principal components, and rows brought to equal variance along them."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

if TYPE_CHECKING:
    from sklearn.decomposition import PCA

#: Components with a smaller share of the first one's variance are rounding, which whitening would blow up.
SMALLEST_SHARE = 1e-7


def principal(centred: Float64[ndarray, "n d"], count: int) -> tuple[Float64[ndarray, "k"], Float64[ndarray, "d k"]]:
    """Sums of squares along the leading orthonormal directions of rows whose mean is 0, and the directions.

    Eigenvectors of ``XᵀX``, or those u of ``X Xᵀ`` as ``Xᵀu / ||Xᵀu||``, whichever matrix is smaller: one image
    more costs little where images are fewer than their pixels. Largest first; directions whose share of the first
    one's sum is below ``SMALLEST_SHARE`` are rounding and left out, so there may be fewer than ``count``.

    Example:
        >>> rows = np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
        >>> sums, directions = principal(rows, 3)
        >>> sums.round(9).tolist(), abs(directions).round(9).tolist()
        ([18.0, 2.0], [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    """
    from scipy.linalg import eigh

    few = len(centred) < centred.shape[1]
    gram = centred @ centred.T if few else centred.T @ centred
    size = len(gram)
    sums, vectors = eigh(gram, subset_by_index=(max(0, size - count), size - 1))
    kept = np.flatnonzero((sums > 0) & (sums > SMALLEST_SHARE * sums[-1]))[::-1]
    sums, vectors = sums[kept], vectors[:, kept]
    if few:
        vectors = centred.T @ vectors
        vectors /= np.linalg.norm(vectors, axis=0)
    return sums, vectors


def whitening(rows: Float32[ndarray, "n d"], dimensions: int, *, or_fewer: bool = False) -> "PCA":
    """``y = Λ^(-1/2) Vᵀ (x - m)`` with the mean, leading eigenvectors and eigenvalues of the covariance of ``rows``.

    Args:
        rows: one descriptor of a reference image a row.
        dimensions: components that are kept.
        or_fewer: keep as many as the rows span where these are fewer.

    Raises:
        ValueError: there are no more rows than ``dimensions``, or they span fewer directions; with ``or_fewer``,
            there is one, or all are equal.

    Example:
        >>> rows = np.random.default_rng(0).normal(size=(50, 8)).astype(np.float32)
        >>> np.cov(whitening(rows, 2).transform(rows).T).round(4) + 0.0
        array([[1., 0.],
               [0., 1.]])
    """
    from sklearn.decomposition import PCA

    if or_fewer:
        dimensions = max(1, min(dimensions, len(rows) - 1, rows.shape[1]))
    if dimensions >= len(rows):
        raise ValueError(f"dimensions={dimensions} needs more reference images than that; got {len(rows)}")
    if dimensions > rows.shape[1]:
        raise ValueError(f"dimensions={dimensions}, but a descriptor has only {rows.shape[1]} numbers")
    centred = rows.astype(np.float64)
    mean = centred.mean(axis=0)
    centred -= mean
    sums, directions = principal(centred, dimensions)
    if len(sums) < (1 if or_fewer else dimensions):
        raise ValueError(f"dimensions={dimensions}, but the reference images span only {len(sums)} directions")
    pca = PCA(len(sums), whiten=True)
    pca.n_components_ = len(sums)
    for name, value in (("mean", mean), ("components", directions.T), ("explained_variance", sums / (len(rows) - 1))):
        setattr(pca, f"{name}_", np.ascontiguousarray(value, dtype=rows.dtype))
    return pca
