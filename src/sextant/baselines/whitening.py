"""Principal components brought to equal variance, learnt from descriptors of reference images."""

from typing import TYPE_CHECKING

from jaxtyping import Float32
from numpy import ndarray

if TYPE_CHECKING:
    from sklearn.decomposition import PCA

#: Components with a smaller share of the first one's variance are rounding, which whitening would blow up.
SMALLEST_SHARE = 1e-7


def whitening(rows: Float32[ndarray, "n d"], dimensions: int, *, or_fewer: bool = False) -> "PCA":
    """``y = Λ^(-1/2) Vᵀ (x - m)`` with the mean, leading eigenvectors and eigenvalues of the covariance of ``rows``.

    Args:
        rows: descriptors of reference images, one per row.
        dimensions: number of components kept.
        or_fewer: if the rows span fewer directions, keep as many as they span.

    Raises:
        ValueError: there are no more rows than ``dimensions``, or they span fewer directions; with ``or_fewer``,
            there is only one row.

    Example:
        >>> import numpy as np
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
    # with fewer rows than numbers in a row, the covariance takes far longer than the rows themselves
    solver = "full" if len(rows) < rows.shape[1] else "covariance_eigh"
    pca = PCA(dimensions, whiten=True, svd_solver=solver).fit(rows)
    variance = pca.explained_variance_
    rank = int((variance > SMALLEST_SHARE * variance[0]).sum()) if variance[0] > 0 else 0
    if or_fewer and 0 < rank < dimensions:
        pca.n_components_ = rank
        pca.components_, pca.explained_variance_ = pca.components_[:rank], variance[:rank]
    elif rank < dimensions:
        raise ValueError(f"dimensions={dimensions}, but the reference images span only {rank} directions")
    return pca
