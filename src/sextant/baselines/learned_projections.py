"""Descriptors that learn a linear map of pixels: principal components, discriminants, canonical correlations."""

from abc import abstractmethod
from typing import TYPE_CHECKING, Self

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from sextant.baselines.place_descriptors import CHUNK, Pixels, PlaceDescriptor, grey_images, unit_norm
from sextant.ranges import Count, checked

if TYPE_CHECKING:
    from sklearn.decomposition import PCA


#: Components below this share of the first one's variance are rounding errors, which whitening would amplify.
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
    # with fewer rows than numbers in a row, decomposing the covariance takes far longer than decomposing the rows
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


class WhitenedPCA(PlaceDescriptor):
    """``y = Λ^(-1/2) Vᵀ (x - m)`` scaled to ``||y|| = 1``, where x are standardised pixels.

    Mean m, leading eigenvectors V and eigenvalues Λ of the covariance are those of the reference images alone.

    Source: Jégou and Chum 2012, "Negative evidences and co-occurrences in image retrieval", section 3.

    Args:
        height, width: size in pixels at which the images are described.
        dimensions: largest length of a descriptor; reference images that span fewer directions give fewer.
        most_images: most images that ``fit`` uses, evenly spaced; bounds the memory, ``4 height width`` bytes each.

    Attributes:
        pca_: the fitted ``sklearn.decomposition.PCA``.

    Example:
        >>> images = np.random.default_rng(0).integers(0, 256, (20, 8, 8, 1), dtype=np.uint8)
        >>> descriptors = WhitenedPCA(8, 8, dimensions=5).fit(images).describe(images)
        >>> descriptors.shape, bool(np.allclose(np.linalg.norm(descriptors, axis=1), 1))
        ((20, 5), True)
    """

    @checked
    def __init__(
        self,
        height: Count = 32,
        width: Count = 64,
        dimensions: Count = 128,
        most_images: Count = 10_000,
    ):
        super().__init__(height, width)
        self.dimensions, self.most_images = dimensions, most_images

    def fit(self, images: UInt8[ndarray, "n h w c"]) -> Self:
        """Learn the components from the reference images.

        Raises:
            ValueError: there is only one image.
        """
        if len(images) < 2:
            raise ValueError("principal components need at least two reference images; got one")
        step = -(-len(images) // max(self.most_images, self.dimensions + 1))
        pixels = Pixels(self.height, self.width).describe(images[::step])
        self.pca_ = whitening(pixels, self.dimensions, or_fewer=True)
        return self

    def describe_grey(self, grey: Float32[ndarray, "n h w"]) -> Float32[ndarray, "n d"]:
        """Unit-norm whitened components.

        Raises:
            NotFittedError: ``fit`` was not called.
        """
        if not hasattr(self, "pca_"):
            from sklearn.exceptions import NotFittedError

            raise NotFittedError("WhitenedPCA.fit was not called: it learns from the reference images")
        pixels = Pixels(self.height, self.width).describe_grey(grey)
        return unit_norm(self.pca_.transform(pixels).astype(np.float32))


class PairedDescriptor(PlaceDescriptor):
    """Linear maps of standardised pixels, one for each of two conditions, that are learnt from pairs.

    ``describe`` is for images of the reference's condition and ``describe_query`` for those of the query's: each
    condition has its own mean image, which is subtracted first.

    Pixels are first reduced to the principal components of both conditions, each about its mean: there are fewer pairs
    than pixels, and directions in which the images do not vary cannot be learnt.

    Args:
        height, width: size in pixels at which the images are described.
        dimensions: length of a descriptor, at most ``components``.
        components: principal components of the pixels, fewer than the images of both conditions together.

    Attributes:
        basis_: principal components (pixels, components).
        reference_mean_, query_mean_: means of standardised pixels.
        reference_map_, query_map_: maps from components to descriptors (components, dimensions).
    """

    def __init__(self, height: int = 32, width: int = 64, dimensions: int = 128, components: int = 256):
        super().__init__(height, width)
        self.dimensions, self.components = dimensions, components

    def fit(self, images: UInt8[ndarray, "n h w c"]) -> Self:
        """Not possible from one condition.

        Raises:
            TypeError: always.
        """
        raise TypeError(f"{type(self).__name__} learns from pairs: call fit_pairs(reference, query)")

    def fit_pairs(self, reference: UInt8[ndarray, "n h1 w1 c1"], query: UInt8[ndarray, "n h2 w2 c2"]) -> Self:
        """Learn from images of the same places, which share an index.

        Raises:
            ValueError: the numbers of images differ, or they span fewer than ``components`` directions.
        """
        if not 1 <= self.dimensions <= self.components:
            raise ValueError(f"dimensions={self.dimensions} must be in [1, components={self.components}]")
        if len(reference) != len(query) or len(reference) < 2:
            raise ValueError(f"need two or more pairs; got {len(reference)} reference and {len(query)} query images")
        pixels = Pixels(self.height, self.width)
        first, second = (pixels.describe(images).astype(np.float64) for images in (reference, query))
        self.reference_mean_, self.query_mean_ = first.mean(axis=0), second.mean(axis=0)
        first, second = first - self.reference_mean_, second - self.query_mean_
        self.basis_ = _principal(first, second, self.components)
        self.reference_map_, self.query_map_ = self.learn_maps(first @ self.basis_, second @ self.basis_)
        return self

    @abstractmethod
    def learn_maps(self, reference: ndarray, query: ndarray) -> tuple[ndarray, ndarray]:
        """Two maps (p, dimensions) from the components (n, p) of each condition, whose mean is 0, to descriptors."""

    def describe_query(self, images: UInt8[ndarray, "n h w c"]) -> Float32[ndarray, "n d"]:
        """One descriptor per row, for images of the query's condition.

        Raises:
            NotFittedError: ``fit_pairs`` was not called.
            ValueError: the images are not what ``grey_images`` takes.
        """
        chunks = [images[start : start + CHUNK] for start in range(0, max(len(images), 1), CHUNK)]
        grey = (grey_images(chunk, self.height, self.width) for chunk in chunks)
        return np.concatenate([self._project(each, query=True) for each in grey])

    def describe_grey(self, grey: Float32[ndarray, "n h w"]) -> Float32[ndarray, "n d"]:
        """Unit-norm descriptors of images of the reference's condition.

        Raises:
            NotFittedError: ``fit_pairs`` was not called.
        """
        return self._project(grey, query=False)

    def _project(self, grey: Float32[ndarray, "n h w"], query: bool) -> Float32[ndarray, "n d"]:
        if not hasattr(self, "basis_"):
            from sklearn.exceptions import NotFittedError

            raise NotFittedError(f"{type(self).__name__}.fit_pairs was not called: it learns from pairs of images")
        mean, onto = (self.query_mean_, self.query_map_) if query else (self.reference_mean_, self.reference_map_)
        pixels = Pixels(self.height, self.width).describe_grey(grey).astype(np.float64)
        return unit_norm(((pixels - mean) @ self.basis_ @ onto).astype(np.float32))


def _principal(first: ndarray, second: ndarray, components: int) -> ndarray:
    """Leading eigenvectors (pixels, components) of the two conditions' mean covariance."""
    from scipy.linalg import eigh

    images, pixels = 2 * len(first), first.shape[1]
    if components > pixels:
        raise ValueError(f"components={components}, but the images have only {pixels} pixels")
    covariance = (first.T @ first + second.T @ second) / images
    variances, vectors = eigh(covariance, subset_by_index=(pixels - components, pixels - 1))
    rank = int((variances > SMALLEST_SHARE * variances[-1]).sum()) if variances[-1] > 0 else 0
    if rank < components:
        raise ValueError(f"components={components}, but the pairs span only {rank} directions")
    return np.asarray(vectors[:, ::-1])


def ridge(covariance: ndarray, share: float) -> ndarray:
    """``C + share * tr(C) / p * I``: the covariance, regularized by a share of its mean variance."""
    size = len(covariance)
    return np.asarray(covariance + share * np.trace(covariance) / size * np.eye(size))


class LDA(PairedDescriptor):
    r"""The directions with the largest variation between places relative to that of a place between two conditions.

    With components :math:`a_i, b_i` of place i in the two conditions, each of mean 0,

    .. math:: W = \tfrac{1}{4n} \sum_i (a_i - b_i)(a_i - b_i)^\top, \quad
       B = \tfrac{1}{4n} \sum_i (a_i + b_i)(a_i + b_i)^\top, \qquad B v = \lambda (W + \gamma \bar W I) v,

    where :math:`\bar W = \operatorname{tr} W / p`. The vectors v of the largest λ, of norm one in
    :math:`W + \gamma \bar W I`, map both conditions. The descriptor is scaled to norm one.

    Source: J. H. Friedman, "Regularized discriminant analysis", JASA 1989, for the ridge; Fisher's criterion.

    Args:
        height, width, dimensions, components: as for :class:`PairedDescriptor`.
        shrinkage: γ, above 0.

    Example:
        >>> import numpy as np
        >>> day = np.random.default_rng(0).integers(0, 200, (20, 8, 8, 1), dtype=np.uint8)
        >>> night = day // 3  # the same places, darker
        >>> lda = LDA(8, 8, dimensions=4, components=8).fit_pairs(day, night)
        >>> bool((lda.describe(day) * lda.describe_query(night)).sum(1).min() > 0.99)  # cosines of a place with itself
        True
    """

    def __init__(
        self,
        height: int = 32,
        width: int = 64,
        dimensions: int = 128,
        components: int = 256,
        shrinkage: float = 0.3,
    ):
        super().__init__(height, width, dimensions, components)
        self.shrinkage = shrinkage

    def learn_maps(self, reference: ndarray, query: ndarray) -> tuple[ndarray, ndarray]:
        """Discriminant directions, the same for both conditions."""
        from scipy.linalg import eigh

        if not self.shrinkage > 0:
            raise ValueError(f"shrinkage={self.shrinkage} must be above 0")
        apart, together = reference - query, reference + query
        within = ridge(apart.T @ apart / (4 * len(apart)), self.shrinkage)
        between = together.T @ together / (4 * len(together))
        size = len(within)
        _, vectors = eigh(between, within, subset_by_index=(size - self.dimensions, size - 1))
        return vectors[:, ::-1], vectors[:, ::-1]


class CCA(PairedDescriptor):
    r"""One map for each condition, such that the two descriptors of a place agree.

    With covariances :math:`C_{aa}, C_{bb}, C_{ab}` of the components, the first two regularized by γ times their mean
    variance, and the singular value decomposition

    .. math:: C_{aa}^{-1/2} C_{ab} C_{bb}^{-1/2} = U R V^\top, \qquad
       A = C_{aa}^{-1/2} U R^{\alpha}, \quad B = C_{bb}^{-1/2} V R^{\alpha},

    R holds the canonical correlations, largest first, of which ``dimensions`` are kept. α = 1/2 is the posterior mean
    of the latent variable of probabilistic CCA; α = 0 weights all alike. Inverse roots are Cholesky factors.
    The descriptor is scaled to norm one.

    Sources: H. Hotelling, Biometrika 1936; H. D. Vinod, "Canonical ridge", Journal of Econometrics 1976; F. Bach and
    M. Jordan, "A probabilistic interpretation of canonical correlation analysis", 2005.

    Args:
        height, width, dimensions, components: as for :class:`PairedDescriptor`.
        shrinkage: γ, above 0.
        weighting: α, at least 0.

    Example:
        >>> day = np.random.default_rng(0).integers(0, 200, (20, 8, 8, 1), dtype=np.uint8)
        >>> night = 255 - day  # the same places as negatives
        >>> cca = CCA(8, 8, dimensions=4, components=8).fit_pairs(day, night)
        >>> bool((cca.describe(day) * cca.describe_query(night)).sum(1).min() > 0.99)  # cosines of a place with itself
        True
    """

    def __init__(
        self,
        height: int = 32,
        width: int = 64,
        dimensions: int = 128,
        components: int = 256,
        shrinkage: float = 0.1,
        weighting: float = 0.5,
    ):
        super().__init__(height, width, dimensions, components)
        self.shrinkage, self.weighting = shrinkage, weighting

    def learn_maps(self, reference: ndarray, query: ndarray) -> tuple[ndarray, ndarray]:
        """Canonical directions of each condition; ``correlations_`` are those of the regularized covariances."""
        from scipy.linalg import solve_triangular, svd

        if not self.shrinkage > 0 or not self.weighting >= 0:
            raise ValueError(f"shrinkage={self.shrinkage} must be above 0, weighting={self.weighting} at least 0")
        count = len(reference)
        first, second = (
            np.linalg.cholesky(ridge(each.T @ each / count, self.shrinkage)) for each in (reference, query)
        )
        half = solve_triangular(first, reference.T @ query / count, lower=True)
        left, correlations, right = svd(solve_triangular(second, half.T, lower=True).T)
        kept = slice(self.dimensions)
        self.correlations_ = correlations[kept]
        weights = correlations[kept] ** self.weighting
        return (
            solve_triangular(first.T, left[:, kept]) * weights,
            solve_triangular(second.T, right[kept].T) * weights,
        )
