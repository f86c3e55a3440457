"""What the training-free descriptors share: fit, describe, bounded memory."""

from abc import ABC, abstractmethod
from typing import Literal, Self

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from sextant.baselines.grey import grey_images

#: Images described at a time: bounds the memory to some megabytes besides input and result.
CHUNK = 512


class PlaceDescriptor(ABC):
    """Maps each image to a vector that should be similar for images of one place.

    Attributes:
        similarity: how two descriptors are compared. Cosine for all here: a flat image or patch carries no structure
            and becomes zeros, which by Euclidean distance would be the nearest neighbour of every hard query.

    Args:
        height, width: size in pixels at which the images are described.
    """

    similarity: Literal["cosine"] = "cosine"

    def __init__(self, height: int = 32, width: int = 64):
        self.height, self.width = height, width

    def fit(self, images: UInt8[ndarray, "n h w c"]) -> Self:
        """Learn from the reference images; most descriptors learn nothing."""
        return self

    def describe(self, images: UInt8[ndarray, "n h w c"]) -> Float32[ndarray, "n d"]:
        """One descriptor per row.

        Raises:
            ValueError: the images are not what ``grey_images`` takes, or a parameter does not fit their size.
        """
        chunks = [images[start : start + CHUNK] for start in range(0, max(len(images), 1), CHUNK)]
        return np.concatenate([self.describe_grey(grey_images(chunk, self.height, self.width)) for chunk in chunks])

    def describe_query(self, images: UInt8[ndarray, "n h w c"]) -> Float32[ndarray, "n d"]:
        """The same, of images of the query's condition; only descriptors learnt from pairs distinguish the two."""
        return self.describe(images)

    @abstractmethod
    def describe_grey(self, grey: Float32[ndarray, "n h w"]) -> Float32[ndarray, "n d"]:
        """Descriptors of grey images in [0, 1] of this descriptor's size."""


def unit_norm(rows: Float32[ndarray, "n d"]) -> Float32[ndarray, "n d"]:
    """``x / ||x||`` of every row; rows of zeros stay zeros."""
    norms = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(np.divide(rows, norms, out=np.zeros_like(rows), where=norms > 0))
