"""ALIKED's local features, matched by LightGlue, in kornia's implementation; the weights are files of the user.

The published files are ``aliked-n16.pth`` (BSD-3) and ``aliked_lightglue.pth`` (Apache-2.0). Files with other hashes
are refused. Sources: X. Zhao et al., "ALIKED", 2023; P. Lindenberger et al., "LightGlue", ICCV 2023.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
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
from sextant.errors import ArgumentError, naming_extras
from sextant.ranges import Count, FeatureSide, checked
from sextant.torch_file import building

#: names of both files and their hashes
DETECTOR = ("aliked-n16.pth", "5be8704840ed662d9d8c561bf7279c222092674e7eb05fd0feab94899e9d82f2")
MATCHER = ("aliked_lightglue.pth", "d975e965b105311a6143194852297dff4f02aea5cc2e10cecfed966ca0e22503")
#: buffers that both networks compute themselves
CONSTANTS = ("dkd.hw_grid", "confidence_thresholds")
#: the network pads sides to multiples of this by itself; such images need no padding
MULTIPLE = 32


@checked
@dataclass(frozen=True)
class AlikedFeatures:
    """ALIKED's keypoints and descriptors of 128 numbers, and LightGlue's matches.

    Args:
        weights: folder with both files.
        keypoints, side: as for :class:`~sextant.correspondence.XFeatures`.

    Raises:
        ArgumentError: an argument is out of range, or a file is missing or not the published one.

    Example:
        >>> AlikedFeatures("/models").detect(images)  # doctest: +SKIP
    """

    weights: Path | str
    keypoints: Count = 1024
    side: FeatureSide | None = 640
    name: str = "aliked"

    def __post_init__(self) -> None:
        for name, sha256 in (DETECTOR, MATCHER):
            path = Path(self.weights).expanduser() / name
            fix = f"Put the published {name} there (SHA-256 {sha256[:12]}...), or choose local=xfeat."
            if not path.is_file():
                raise ArgumentError(f"weights={self.weights}: {path} is missing", fix, of=self)
            found = hash_file(path)
            if found != sha256:
                told = f"weights={self.weights}: {path} is not the published file: its SHA-256 is {found[:12]}..."
                raise ArgumentError(told, fix, of=self)

    @property
    def model(self) -> str:
        """Identifies weights and settings."""
        return f"aliked {self.keypoints} {self.side} {DETECTOR[1][:12]}"

    def check(self) -> None:
        """Raise an ``ArgumentError`` if packages are missing."""
        check_packages("kornia", "poselib")

    @torch.no_grad()
    def detect(self, images: Sequence[UInt8[ndarray, "h w 3"]]) -> list[LocalFeatures]:
        """The features of each image."""
        found = []
        for image, pixels in zip(images, network_inputs(images, self.side, MULTIPLE), strict=True):
            (each,) = self._detector(pixels)
            order = each.keypoint_scores.argsort(descending=True).numpy()
            points, descriptors = each.keypoints.numpy()[order], each.descriptors.numpy()[order]
            found.append(in_image(points, descriptors, image, *pixels.shape[2:]))
        return found

    @torch.no_grad()
    def match(self, first: LocalFeatures, second: LocalFeatures) -> Int64[ndarray, "m 2"]:
        """LightGlue's matches."""
        if not len(first) or not len(second):
            return np.empty((0, 2), np.int64)
        given = {
            key: {
                "keypoints": torch.from_numpy(each.points.clip(0, _size(each)))[None],
                "descriptors": torch.from_numpy(each.descriptors.astype(np.float32))[None],
                "image_size": torch.tensor([[each.width, each.height]]),
            }
            for key, each in (("image0", first), ("image1", second))
        }
        return np.asarray(self._matcher(given)["matches"][0].numpy(), np.int64)

    @cached_property
    def _detector(self) -> Any:
        with naming_extras("local features"):
            from kornia.feature import ALIKED
        with building():
            network = ALIKED("aliked-n16", self.keypoints)
        return _loaded(network, _read(self.weights, DETECTOR[0]), DETECTOR[0])

    @cached_property
    def _matcher(self) -> Any:
        with naming_extras("local features"):
            from kornia.feature.lightglue import LightGlue
        with building():
            network = LightGlue(None, input_dim=128)  # type: ignore[arg-type]
        state = _read(self.weights, MATCHER[0])
        for layer in range(network.conf.n_layers):  # names of the published file
            for kind in ("self_attn", "cross_attn"):
                before, now = f"{kind}.{layer}.", f"transformers.{layer}.{kind}."
                state = {key.replace(before, now) if key.startswith(before) else key: v for key, v in state.items()}
        return _loaded(network, state, MATCHER[0])


def _size(features: LocalFeatures) -> ndarray:
    return np.array([features.width, features.height], np.float32)


def _loaded(network: Any, state: dict[str, Any], name: str) -> Any:
    """The network with the weights of a file; each of its weights must be in it, by its present name."""
    missing = [key for key in network.load_state_dict(state, strict=False).missing_keys if key not in CONSTANTS]
    if missing:
        raise ArgumentError(
            f"{name} lacks {len(missing)} weights of kornia's network, such as {missing[0]}: this version of kornia "
            "names them otherwise",
            "pip install 'kornia>=0.9,<0.10'",
        )
    return network.eval()


def _read(folder: Path | str, name: str) -> dict[str, Any]:
    found: dict[str, Any] = torch.load(Path(folder).expanduser() / name, map_location="cpu", weights_only=True)
    return found
