"""Whitened principal components of the pixels."""

from typing import Self

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from sextant.baselines.descriptor import PlaceDescriptor, unit_norm
from sextant.baselines.pixels import Pixels
from sextant.baselines.whitening import whitening


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

    def __init__(self, height: int = 32, width: int = 64, dimensions: int = 128, most_images: int = 10_000):
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
