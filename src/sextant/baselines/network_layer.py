r"""A layer of a network that was trained for another task, as a place descriptor.

Intermediate features of an object network survive changes of light better than pixels do, without having been trained
for it: N. Sünderhauf et al., "On the performance of ConvNet features for place recognition", IROS 2015, take ``conv3``
of AlexNet. Here the layer's map is first averaged over the cells of a grid, so that the descriptor is short, then
flattened, optionally whitened, and scaled to unit length.
"""

from typing import Self

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, Float32, UInt8
from numpy import ndarray
from torch import Tensor, nn

from sextant.baselines.learned_projections import whitening
from sextant.baselines.place_descriptors import PlaceDescriptor, unit_norm
from sextant.errors import ArgumentError
from sextant.ranges import Count, checked

#: images described at a time
BATCH = 64


class NetworkLayer(PlaceDescriptor):
    """``unit(whiten(mean over the cells of a grid (f(image))))``; the network f is not trained further.

    Args:
        features: maps images ``(b, channels, h, w)`` in [0, 1] to a map ``(b, c, h2, w2)``.
        height, width: size in pixels to which images are resized first.
        channels: 1 or 3; grey images are repeated for 3, colours are averaged for 1.
        grid: rows and columns of cells, at most as many as the map has.
        dimensions: number of whitened principal components, learnt by ``fit`` from reference images; None keeps all
            numbers.

    Attributes:
        pca_: the fitted ``sklearn.decomposition.PCA``, if ``dimensions`` is given.

    Raises:
        ArgumentError: channels are neither 1 nor 3, or the grid is empty.

    Example:
        >>> network = NetworkLayer(nn.Conv2d(3, 6, 3), height=32, width=64, grid=(2, 4))
        >>> network.describe(np.zeros((5, 48, 64, 3), np.uint8)).shape  # 6 · 2 · 4
        (5, 48)
    """

    @checked
    def __init__(
        self,
        features: nn.Module,
        height: Count,
        width: Count,
        *,
        channels: int = 3,
        grid: tuple[Count, Count] = (4, 8),
        dimensions: Count | None = None,
    ):
        super().__init__(height, width)
        if channels not in (1, 3):
            raise ArgumentError(f"channels={channels} must be 1 or 3")
        self.features = features.eval().requires_grad_(False)
        self.channels, self.grid, self.dimensions = channels, grid, dimensions

    def fit(self, images: UInt8[ndarray, "n h w c"]) -> Self:
        """Learn the whitening, if there is one, from reference images.

        Raises:
            ValueError: the images span fewer than ``dimensions`` directions.
        """
        if self.dimensions is not None:
            self.pca_ = whitening(self._rows(images), self.dimensions)
        return self

    def describe(self, images: UInt8[ndarray, "n h w c"]) -> Float32[ndarray, "n d"]:
        """One descriptor per row.

        Raises:
            NotFittedError: there is a whitening, and ``fit`` was not called.
        """
        return self._finish(self._rows(images))

    def describe_grey(self, grey: Float32[ndarray, "n h w"]) -> Float32[ndarray, "n d"]:
        """Descriptors of grey images in [0, 1]."""
        parts = [self._pooled(torch.from_numpy(np.ascontiguousarray(part))[:, None]) for part in _batches(grey)]
        return self._finish(np.concatenate(parts))

    def _rows(self, images: UInt8[ndarray, "n h w c"]) -> Float32[ndarray, "n d"]:
        """Averages over the cells of the grid, one image per row."""
        writable = (np.require(part, requirements=("C", "W")) for part in _batches(images))  # torch warns about others
        bytes_of = (torch.from_numpy(part).permute(0, 3, 1, 2) for part in writable)
        return np.concatenate([self._pooled(part.float() / 255) for part in bytes_of])

    @torch.no_grad()
    def _pooled(self, images: Float[Tensor, "b k h w"]) -> Float32[ndarray, "b d"]:
        x = images if images.shape[1] == self.channels else images.mean(1, keepdim=True)
        x = x.expand(-1, self.channels, -1, -1)
        if x.shape[2:] != (self.height, self.width):
            x = F.interpolate(x, (self.height, self.width), mode="bilinear", antialias=True, align_corners=False)
        device = next((parameter.device for parameter in self.features.parameters()), torch.device("cpu"))
        found = self.features(x.to(device))
        cells = min(self.grid[0], found.shape[2]), min(self.grid[1], found.shape[3])
        return F.adaptive_avg_pool2d(found, cells).flatten(1).float().cpu().numpy()

    def _finish(self, rows: Float32[ndarray, "n d"]) -> Float32[ndarray, "n k"]:
        if self.dimensions is None:
            return unit_norm(rows)
        if not hasattr(self, "pca_"):
            from sklearn.exceptions import NotFittedError

            raise NotFittedError("NetworkLayer.fit was not called: its whitening is learnt from the reference images")
        return unit_norm(self.pca_.transform(rows).astype(np.float32))


def _batches(images: ndarray) -> list[ndarray]:
    return [images[start : start + BATCH] for start in range(0, max(len(images), 1), BATCH)]
