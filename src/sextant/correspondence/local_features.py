"""Local features of an image, and what extracts and matches them."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import groupby
from typing import Protocol

import numpy as np
import torch
from jaxtyping import Float, Float16, Float32, Int64, UInt8
from numpy import ndarray
from torch import Tensor
from torch.nn.functional import interpolate

from sextant.errors import ArgumentError, how_to_install, shown
from sextant.ranges import Count, Positive, checked
from sextant.shapes import check_shape


@checked
@dataclass(frozen=True, eq=False)
class LocalFeatures:
    """The keypoints of an image, the strongest first.

    Attributes:
        points: pixels (x, y) of the image; (0, 0) is the centre of the first pixel.
        descriptors: of unit length.
        width, height: of the image.
        pixel: side of a pixel of the picture that they were detected in, in pixels of the image; errors are measured
            in it.

    Raises:
        ArgumentError: points and descriptors differ in number or have other shapes, a point is not finite, or a size is
            not above 0.
    """

    points: Float32[ndarray, "n 2"]
    descriptors: Float16[ndarray, "n d"]
    width: Count
    height: Count
    pixel: Positive = 1.0

    def __post_init__(self) -> None:
        check_shape("points", self.points, "n", 2)
        check_shape("descriptors", self.descriptors, len(self.points), "d")
        if not np.isfinite(self.points).all():
            wrong = int(np.isfinite(self.points).all(axis=1).argmin())
            told = f"points={shown(self.points[wrong])} of keypoint {wrong} must be finite"
            raise ArgumentError(told, "Leave the keypoint out.", of=self)

    def __len__(self) -> int:
        return len(self.points)

    @property
    def nbytes(self) -> int:
        """Memory of points and descriptors."""
        return self.points.nbytes + self.descriptors.nbytes

    def strongest(self, n: int) -> "LocalFeatures":
        """The first ``n`` keypoints."""
        return replace(self, points=self.points[:n], descriptors=self.descriptors[:n])


Matcher = Callable[[LocalFeatures, LocalFeatures], Int64[ndarray, "m 2"]]
#: images whose longer side exceeds that of an extractor by more than this factor are reduced first
REDUCED = 4


class LocalFeatureExtractor(Protocol):
    """Detects, describes and matches keypoints.

    It may have a method ``check()``, which raises a ``UserError`` if it cannot work; it is called before any work.

    Attributes:
        name: of the kind of features.
        side: longer side, in pixels, to which images are scaled; None keeps their size.
        model: identifies weights and settings: features of equal ``model`` can be compared.
    """

    @property
    def name(self) -> str:
        """See above."""

    @property
    def side(self) -> int | None:
        """See above."""

    @property
    def model(self) -> str:
        """See above."""

    def detect(self, images: Sequence[UInt8[ndarray, "h w 3"]]) -> list[LocalFeatures]:
        """The features of each image."""

    def match(self, first: LocalFeatures, second: LocalFeatures) -> Int64[ndarray, "m 2"]:
        """Numbers of matching features in the first and in the second image."""


def detected(extractor: LocalFeatureExtractor, pixels: UInt8[ndarray, "h w 3"]) -> LocalFeatures:
    """Local features; of an image far larger than they are detected in, by a reduced one, which needs less memory."""
    height, width = pixels.shape[:2]
    if extractor.side is None or max(height, width) <= REDUCED * extractor.side:
        return extractor.detect([pixels])[0]
    import cv2

    scale = 2 * extractor.side / max(height, width)
    rows, columns = (max(1, round(side * scale)) for side in (height, width))
    found = extractor.detect([cv2.resize(pixels, (columns, rows), interpolation=cv2.INTER_AREA)])[0]
    back = np.array([width / columns, height / rows], np.float32)
    points = ((found.points + 0.5) * back - 0.5).astype(np.float32)
    return LocalFeatures(points, found.descriptors, width, height, found.pixel * float(back.max()))


def check_packages(*packages: str) -> None:
    """Raise an ``ArgumentError`` if packages of the extra ``local`` are not installed, without importing them."""
    if missing := [package for package in packages if find_spec(package) is None]:
        raise ArgumentError(
            f"local features need {' and '.join(missing)}, which is not installed", how_to_install("local")
        )


def network_inputs(
    images: Iterable[UInt8[ndarray, "h w 3"]], side: int | None, multiple: int
) -> Iterator[Float[Tensor, "1 3 rows columns"]]:
    """Each image in [0, 1], scaled to a longer side, both sides rounded to multiples of a number.

    One at a time: on a CPU larger batches are no faster, and need more memory.
    """
    for (height, width), same in groupby(images, key=lambda image: image.shape[:2]):
        scale = 1.0 if side is None else side / max(height, width)
        rows, columns = (max(1, round(scale * each / multiple)) * multiple for each in (height, width))
        for image in same:
            pixels = torch.from_numpy(np.array(image)).permute(2, 0, 1)[None].float() / 255
            smaller = rows < height or columns < width
            yield interpolate(pixels, (rows, columns), mode="bilinear", antialias=smaller)


def in_image(
    points: Float[ndarray, "n 2"],
    descriptors: Float[ndarray, "n d"],
    image: UInt8[ndarray, "h w 3"],
    rows: int,
    columns: int,
) -> LocalFeatures:
    """Features with their pixels of a network's input, as features of the image."""
    height, width = image.shape[:2]
    scale = np.array([width / columns, height / rows], np.float32)
    return LocalFeatures(
        (points.astype(np.float32) + 0.5) * scale - 0.5,
        descriptors.astype(np.float16),
        width,
        height,
        max(1.0, width / columns, height / rows),
    )
