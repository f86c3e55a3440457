"""Histograms of oriented gradients on a coarse grid."""

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from sextant.baselines.descriptor import PlaceDescriptor


class Hog(PlaceDescriptor):
    """Histograms of gradient orientation (mod 180°), weighted by magnitude, in a grid of cells: 256 values.

    Each cell is a block of its own, so ``v = h / sqrt(||h||² + 1e-10)`` cell by cell; flat cells are zeros. The
    histograms are those of ``skimage.feature.hog``; OpenCV 5 no longer ships its own.

    Source: Dalal and Triggs 2005, "Histograms of Oriented Gradients for Human Detection", section 6.

    Args:
        height, width: size in pixels at which the images are described; multiples of ``rows`` and ``columns``.
        rows, columns: size of the grid of cells.
        bins: orientations, at least 1.

    Example:
        >>> bars = np.zeros((1, 32, 64, 1), np.uint8)
        >>> bars[:, :, 3::8] = 255  # upright bars, whose gradients are horizontal
        >>> descriptor = Hog().describe(bars)
        >>> descriptor.shape, int(descriptor.reshape(-1, 8).sum(0).argmax())  # the first of 8 orientations
        ((1, 256), 0)
    """

    def __init__(self, height: int = 32, width: int = 64, rows: int = 4, columns: int = 8, bins: int = 8):
        super().__init__(height, width)
        self.rows, self.columns, self.bins = rows, columns, bins

    def describe_grey(self, grey: Float32[ndarray, "n h w"]) -> Float32[ndarray, "n d"]:
        """Histograms, cell by cell."""
        from skimage.feature import hog

        if self.height % self.rows or self.width % self.columns:
            raise ValueError(
                f"the grid of {self.rows} x {self.columns} cells must divide height={self.height}, width={self.width}"
            )
        cell = (self.height // self.rows, self.width // self.columns)
        options = {"orientations": self.bins, "pixels_per_cell": cell, "cells_per_block": (1, 1), "block_norm": "L2"}
        return np.stack([hog(image, **options).astype(np.float32) for image in grey])
