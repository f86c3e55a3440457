"""Descriptors of places that need no training: standardised pixels, patches, gradients."""

from abc import ABC, abstractmethod
from typing import Literal, Self

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray
from PIL import Image

from sextant.ranges import Count, checked

#: ITU-R BT.601 weights of red, green and blue.
LUMA = np.array([0.299, 0.587, 0.114], np.float32)


def grey_images(images: UInt8[ndarray, "n h w c"], height: int, width: int) -> Float32[ndarray, "n height width"]:
    """Luma ``0.299 R + 0.587 G + 0.114 B`` in [0, 1], resized with an antialiasing triangle filter.

    Images that have the size already are not resampled. The aspect ratio is not kept.

    >>> grey_images(np.zeros((2, 48, 64, 3), np.uint8), 24, 32).shape
    (2, 24, 32)

    Args:
        images: one or three channels.
        height, width: size of the result in pixels, at least 1.

    Raises:
        ValueError: there is no image, or they are not uint8 with one or three channels.
    """
    if images.ndim != 4 or images.dtype != np.uint8 or len(images) == 0 or images.shape[3] not in (1, 3):
        raise ValueError(f"need uint8 images (n, h, w, 1 or 3), n > 0; got {images.dtype} {images.shape}")
    found = np.empty((len(images), height, width), np.float32)
    for target, image in zip(found, images, strict=True):  # one at a time: in float32, all would take gigabytes
        grey = image[..., 0].astype(np.float32) if image.shape[2] == 1 else image.astype(np.float32) @ LUMA
        grey /= 255
        if grey.shape != (height, width):
            grey = np.asarray(Image.fromarray(grey).resize((width, height), Image.Resampling.BILINEAR))
        target[:] = grey
    return found


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

    @checked
    def __init__(self, height: Count = 32, width: Count = 64):
        self.height, self.width = height, width

    def fit(self, images: UInt8[ndarray, "n h w c"]) -> Self:
        """Fit to the reference images; most descriptors need no fitting."""
        return self

    def describe(self, images: UInt8[ndarray, "n h w c"]) -> Float32[ndarray, "n d"]:
        """One descriptor per row.

        Raises:
            ValueError: the images are not what ``grey_images`` takes, or a parameter does not fit their size.
        """
        chunks = [images[start : start + CHUNK] for start in range(0, max(len(images), 1), CHUNK)]
        return np.concatenate([self.describe_grey(grey_images(chunk, self.height, self.width)) for chunk in chunks])

    def describe_query(self, images: UInt8[ndarray, "n h w c"]) -> Float32[ndarray, "n d"]:
        """The same for images of the query's condition; only descriptors learnt from pairs distinguish the two."""
        return self.describe(images)

    @abstractmethod
    def describe_grey(self, grey: Float32[ndarray, "n h w"]) -> Float32[ndarray, "n d"]:
        """Descriptors of grey images in [0, 1] of this descriptor's size."""


def unit_norm(rows: Float32[ndarray, "n d"]) -> Float32[ndarray, "n d"]:
    """``x / ||x||`` of every row; rows of zeros stay zeros."""
    with np.errstate(over="ignore"):
        norms = np.linalg.norm(rows, axis=1, keepdims=True)
    unit = np.divide(rows, norms, out=np.zeros_like(rows), where=norms > 0)
    # rows whose squares over- or underflow
    extreme = np.flatnonzero(np.isinf(norms) | (norms < np.finfo(rows.dtype).tiny ** 0.5))
    extreme = extreme[rows[extreme].any(axis=1)]
    if len(extreme):
        scaled = rows[extreme] / np.abs(rows[extreme]).max(axis=1, keepdims=True)
        unit[extreme] = scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
    return np.asarray(unit)


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


class PatchNormalised(PlaceDescriptor):
    """``(x - mean_P(x)) / sd_P(x)`` in each square patch P of a grid: ``height * width`` values, patch by patch.

    SeqSLAM sums absolute differences; cosine similarity gives a similar ranking of standardised values with one matrix
    product. Flat patches become zeros.

    Source: Milford and Wyeth 2012, "SeqSLAM", section III.

    Args:
        height, width: size in pixels at which the images are described; multiples of ``patch``.
        patch: side of a patch in pixels, at least 2.

    Example:
        >>> import numpy as np
        >>> image = np.arange(16, dtype=np.uint8).reshape(1, 4, 4, 1) * 9
        >>> brighter = image + np.uint8(50)
        >>> one, other = PatchNormalised(4, 4, patch=2).describe(np.concatenate([image, brighter]))
        >>> bool(np.allclose(one, other, atol=1e-4))  # brightness alone changes nothing
        True
    """

    @checked
    def __init__(
        self,
        height: Count = 32,
        width: Count = 64,
        patch: int = 8,
    ):
        super().__init__(height, width)
        self.patch = patch

    def describe_grey(self, grey: Float32[ndarray, "n h w"]) -> Float32[ndarray, "n d"]:
        """Standardised patches, one after the other."""
        side = self.patch
        if side < 2 or self.height % side or self.width % side:
            raise ValueError(f"patch={side} must be at least 2 and divide height={self.height} and width={self.width}")
        blocks = grey.reshape(len(grey), self.height // side, side, self.width // side, side)
        patches = blocks.swapaxes(2, 3).reshape(len(grey), -1, side * side)  # (n, patches, side²)
        return standardised(patches).reshape(len(grey), -1)


class Hog(PlaceDescriptor):
    """Histograms of gradient orientation (mod 180°), weighted by magnitude, in a grid of cells: 256 values.

    Each cell is a block of its own, so ``v = h / sqrt(||h||² + 1e-10)`` cell by cell; flat cells are zeros. The
    histograms are those of ``skimage.feature.hog``; OpenCV 5 no longer ships its own.

    Source: Dalal and Triggs 2005, "Histograms of Oriented Gradients for Human Detection", section 6.

    Args:
        height, width: size in pixels at which the images are described; multiples of ``rows`` and ``columns``.
        rows, columns: size of the grid of cells, at least 1.
        bins: orientations, at least 1.

    Example:
        >>> bars = np.zeros((1, 32, 64, 1), np.uint8)
        >>> bars[:, :, 3::8] = 255  # upright bars, whose gradients are horizontal
        >>> descriptor = Hog().describe(bars)
        >>> descriptor.shape, int(descriptor.reshape(-1, 8).sum(0).argmax())  # the first of 8 orientations
        ((1, 256), 0)
    """

    @checked
    def __init__(
        self,
        height: Count = 32,
        width: Count = 64,
        rows: Count = 4,
        columns: Count = 8,
        bins: Count = 8,
    ):
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
