"""Hand-picked landmarks as an image descriptor: how strongly, and where, each is detected in the image."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Self

import numpy as np
import torch
from jaxtyping import Float32, UInt8
from numpy import ndarray

from sextant.applications.pixels import AnyImage, as_pixels
from sextant.chapters.cosfire.detector import ExampleDetector
from sextant.chapters.cosfire.network_image import trained_features
from sextant.chapters.places.saved_descriptor import named_baseline
from sextant.errors import ArgumentError
from sextant.runs.outputs_folder import default_outputs
from sextant.tables import counted

#: images that are filtered at a time
BATCH = 32
#: least reach of a filter in pixels
LEAST_REACH = 8.0


class Landmarks:
    r"""COSFIRE filters, one for each point on a photo, and their strongest responses in strips of an image.

    With :math:`R_l(x)` the response of the filter of landmark l, as a share of its response to its own example, the
    descriptor is :math:`\max_{x \in s} R_l(x)` for each landmark l and vertical strip s of the image, from left to
    right. Beside an ordinary descriptor, the numbers are scaled such that over the map their mean variance is
    ``weight`` squared times the other's.

    The photo is taken with the map's camera; it is stretched to the size of the images, and so are the points.

    Args:
        photo: the photo that the points lie on.
        points: x and y in pixels of the upright photo.
        beside: name of an ordinary descriptor that the landmarks are appended to; None for the landmarks alone.
        columns: number of strips of an image.
        reach: reach of the filters, in heights of an image: half the size of a landmark; not for filters on a network.
        weight: weight of the landmarks relative to the ordinary descriptor.
        network: run whose features the filters operate on, instead of Gabor filters.

    Raises:
        UserError: there is no point, an argument is out of range, or there is no such descriptor.

    Example:
        >>> landmarks = Landmarks("corner.png", [(310, 190), (120, 80), (40, 200)])  # doctest: +SKIP
        >>> landmarks.fit(images).describe(images).shape  # doctest: +SKIP
        (250, 152)
    """

    def __init__(
        self,
        photo: AnyImage,
        points: Sequence[tuple[float, float]],
        beside: str | None = "whitened_pca",
        columns: int = 8,
        reach: float = 0.25,
        weight: float = 1.0,
        network: str | None = None,
    ):
        for name, value, least in (("columns", columns, 1), ("reach", reach, 1e-3), ("weight", weight, 1e-6)):
            if not least <= value < 1e6:
                raise ArgumentError(f"{name}={value:g} must be at least {least:g}", f"{name}=1", of=self)
        self.examples: list[tuple[AnyImage, list[tuple[float, float]]]] = []
        self.columns, self.reach, self.weight, self.network = columns, reach, weight, network
        self.ordinary = None if beside is None else named_baseline(beside)
        self.scale = 1.0
        self._detector: ExampleDetector | None = None
        self.add(photo, points)

    def add(self, photo: AnyImage, points: Sequence[tuple[float, float]]) -> Self:
        """Add landmarks on another photo; before :meth:`fit`.

        Raises:
            UserError: there is no point, points are not pairs of finite numbers, or the filters are configured already.
        """
        if self._detector is not None:
            raise ArgumentError("add: the filters are configured already", "Add all landmarks before fit.", of=self)
        try:
            pairs = np.array(points, np.float64)
        except (ValueError, TypeError):
            pairs = np.full(1, np.nan)
        if not pairs.size:
            raise ArgumentError("points=[]: there is no landmark", "points=[[310,190]]", of=self)
        if pairs.ndim != 2 or pairs.shape[1] != 2 or not np.isfinite(pairs).all():
            raise ArgumentError(f"points={points!r} must be pairs of finite numbers", "points=[[310,190]]", of=self)
        self.examples.append((photo, [(x, y) for x, y in pairs.tolist()]))
        return self

    def fit(self, images: UInt8[ndarray, "n h w c"]) -> Self:
        """Configure the filters for images of this size, and fit the weight of landmarks beside the other descriptor.

        Raises:
            UserError: a photo cannot be read, or has nothing at a point to configure a filter from; or the images
                are too low for filters of this reach.
            ValueError: there are too few images for the ordinary descriptor.
        """
        self._detector = self._configured(images.shape[1:])
        if self.ordinary is not None:
            self.ordinary.fit(images)
            rows = images[np.unique(np.linspace(0, len(images) - 1, min(len(images), 500)).astype(int))]
            mine, other = self.responses(rows).var(0).mean(), self.ordinary.describe(rows).var(0).mean()
            self.scale = self.weight * float(np.sqrt(other / mine)) if mine > 0 else self.weight
        return self

    def describe(self, images: UInt8[ndarray, "n h w c"]) -> Float32[ndarray, "n d"]:
        """The ordinary descriptor, if there is one, followed by each landmark's strips."""
        responses = np.float32(self.scale) * self.responses(images)
        if self.ordinary is None:
            return responses
        return np.concatenate([self.ordinary.describe(images), responses], axis=1)

    def responses(self, images: UInt8[ndarray, "n h w c"]) -> Float32[ndarray, "n d"]:
        """Each landmark's strips: responses as shares of the filter's response to its own example.

        Raises:
            UserError: the network cannot take the images.
        """
        detector = self._detector or self._configured(images.shape[1:])
        channels = detector.channels
        found = []
        for start in range(0, len(images), BATCH):
            part = [as_pixels(image, (*images.shape[1:3], channels)) for image in images[start : start + BATCH]]
            tensor = torch.from_numpy(np.stack(part)).permute(0, 3, 1, 2).float() / 255
            found.append(detector.strongest(tensor, self.columns).flatten(1).cpu().numpy())
        return np.concatenate(found).astype(np.float32)

    def _configured(self, shape: Sequence[int]) -> ExampleDetector:
        height, width = shape[:2]
        features = (
            None if self.network is None else trained_features(self.network, default_outputs(), None, trust=False)
        )
        if features is None and self.reach * height < LEAST_REACH:
            raise ArgumentError(
                f"reach={self.reach:g} of {counted(height, 'row')} is {self.reach * height:.1f} pixels, and a filter "
                f"needs at least {LEAST_REACH}",
                f"reach={math.ceil(100 * LEAST_REACH / height) / 100:g}, or larger images", of=self,
            )  # fmt: skip
        detector = ExampleDetector(features, longest=max(height, width), reach=max(LEAST_REACH, self.reach * height))
        for photo, points in self.examples:
            image = as_pixels(photo)
            across, down = width / image.shape[1], height / image.shape[0]
            small = as_pixels(image, (height, width, 3))
            for x, y in points:
                if not (-0.5 <= x <= image.shape[1] - 0.5 and -0.5 <= y <= image.shape[0] - 0.5):
                    name = Path(photo).name if isinstance(photo, str | Path) else "the photo"
                    raise ArgumentError(
                        f"points={x:g},{y:g} lies outside {name} of {image.shape[1]}x{image.shape[0]} pixels",
                        "x and y in pixels of the photo", of=self,
                    )  # fmt: skip
                detector.add(small, ((x + 0.5) * across - 0.5, (y + 0.5) * down - 0.5))
        return detector
