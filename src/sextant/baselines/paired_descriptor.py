"""The base of descriptors that learn from pairs of images: the same places, seen in two conditions."""

from abc import abstractmethod
from typing import Self

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from sextant.baselines.descriptor import CHUNK, PlaceDescriptor, unit_norm
from sextant.baselines.grey import grey_images
from sextant.baselines.pixels import Pixels
from sextant.baselines.whitening import SMALLEST_SHARE


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
    """``C + share * tr(C) / p * I``: the covariance with its small directions lifted."""
    size = len(covariance)
    return np.asarray(covariance + share * np.trace(covariance) / size * np.eye(size))
