"""Pixels, standardised image by image."""

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from sextant.baselines.descriptor import PlaceDescriptor

#: Spread below which an image or patch counts as flat: a quarter of a grey level.
FLAT = 0.25 / 255


class Pixels(PlaceDescriptor):
    """``(x - mean(x)) / sd(x)`` over the pixels of each image: ``height * width`` values.

    Cosine similarity of two such descriptors is their images' correlation coefficient. A flat image becomes zeros.

    Args:
        height, width: size in pixels at which the images are described.

    Example:
        >>> image = np.arange(12, dtype=np.uint8).reshape(1, 3, 4, 1)
        >>> descriptor = Pixels(3, 4).describe(image)
        >>> descriptor.shape, bool(abs(descriptor.mean()) < 1e-6), bool(np.isclose(descriptor.std(), 1))
        ((1, 12), True, True)
    """

    def describe_grey(self, grey: Float32[ndarray, "n h w"]) -> Float32[ndarray, "n d"]:
        """Standardised pixels, row by row."""
        return standardised(grey.reshape(len(grey), -1))


def standardised(values: Float32[ndarray, "*batch d"]) -> Float32[ndarray, "*batch d"]:
    """Subtract the mean of the last axis and divide by its standard deviation; flat ones become zeros."""
    spread = values.std(axis=-1, keepdims=True)
    centred = values - values.mean(axis=-1, keepdims=True)
    return np.asarray(np.divide(centred, spread, out=np.zeros_like(centred), where=spread > FLAT))
