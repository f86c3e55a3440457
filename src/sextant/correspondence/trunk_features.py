r"""Activations of a network as local features: the network that describes an image also tells its points.

At a few depths l of the network, with activations :math:`A_l` of :math:`C_l` channels, the response of a cell is its
strongest channel, standardised over the image,

.. math:: r_l = \frac{m_l - \operatorname{mean} m_l}{\operatorname{sd} m_l}, \qquad m_l = \max_c A_{l,c}.

Keypoints are the local maxima over 3 x 3 cells of :math:`\sum_l r_l`, on the grid of the finest depth, refined by a
parabola in x and in y. A descriptor is the activations of all depths at that point, bilinearly interpolated, of unit
length at each depth. Source: M. Dusmanu et al., "D2-Net", CVPR 2019, whose keypoints are maxima in space and channels.
"""

from collections import OrderedDict
from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int64, UInt8
from numpy import ndarray
from torch import Tensor, nn

from sextant.correspondence.local_features import (
    LocalFeatures,
    check_packages,
    in_image,
    network_inputs,
)
from sextant.correspondence.matching import mutual_matches
from sextant.errors import ArgumentError
from sextant.ranges import Count, FeatureSide, checked

#: ratios of the sides of the image to those of the maps that are used; a finer map is little but edges
STRIDES = (4, 8, 16)


@checked
@dataclass(frozen=True, eq=False)
class TrunkFeatures:
    """Keypoints and descriptors from the activations of a network of convolutions.

    Args:
        network: takes images in [0, 1], ``(b, 3, h, w)``.
        layers: names of the modules whose outputs are used, in any order; by default the last at each of the strides 4,
            8 and 16 or, of a network with ``stages``, the first. Of EfficientNet-Lite0 these are stages 2, 3 and 4.
        keypoints, side: as for :class:`~sextant.correspondence.XFeatures`.
        identity: identifies the weights.

    Raises:
        ArgumentError: an argument is out of range, or the network has no such maps.

    Example:
        >>> import numpy as np
        >>> network = nn.Sequential(nn.Conv2d(3, 8, 3, 4, 1), nn.ReLU(), nn.Conv2d(8, 16, 3, 2, 1), nn.ReLU())
        >>> image = np.random.default_rng(0).integers(0, 255, (96, 128, 3)).astype(np.uint8)
        >>> TrunkFeatures(network, keypoints=50, side=128).detect([image])[0].descriptors.shape
        (50, 24)
    """

    network: nn.Module
    layers: Sequence[str] | None = None
    keypoints: Count = 2048
    side: FeatureSide | None = 640
    identity: str = ""
    name: str = "trunk"

    @property
    def model(self) -> str:
        """Identifies weights and settings."""
        return f"trunk {self.keypoints} {self.side} {self.identity} {','.join(self._used)}"

    def check(self) -> None:
        """Raise an ``ArgumentError`` if the network has no such maps, or packages are missing."""
        check_packages("poselib")
        self._used  # noqa: B018

    @torch.no_grad()
    def detect(self, images: Sequence[UInt8[ndarray, "h w 3"]]) -> list[LocalFeatures]:
        """The features of each image."""
        found = []
        for image, pixels in zip(images, network_inputs(images, self.side, 2 * STRIDES[-1]), strict=True):
            maps = self._maps(pixels)
            points, descriptors = keypoints_of(maps, self.keypoints)
            rows, columns = pixels.shape[2:]
            cell = columns / maps[0].shape[3]
            found.append(in_image((points.numpy() + 0.5) * cell - 0.5, descriptors.numpy(), image, rows, columns))
        return found

    def match(self, first: LocalFeatures, second: LocalFeatures) -> Int64[ndarray, "m 2"]:
        """Mutual nearest neighbours, however similar: cosines of activations are high for any two points."""
        return mutual_matches(first, second, least_cosine=-1.0)

    def _maps(self, pixels: Float[Tensor, "1 3 h w"]) -> list[Float[Tensor, "1 c h2 w2"]]:
        """The activations, the finest first."""
        with _outputs(self.network, self._used) as seen:
            self.network(pixels)
        return [seen[name] for name in self._used]

    @cached_property
    def _used(self) -> list[str]:
        """Names of the modules whose outputs are used, the finest first."""
        known = dict(self.network.named_modules())
        side = 8 * STRIDES[-1]
        names = [name for name in known if name]
        try:
            with torch.no_grad(), _outputs(self.network, names) as seen:
                self.network(torch.zeros(1, 3, 12 * STRIDES[-1], side))
        except (AssertionError, RuntimeError, TypeError, ValueError) as error:
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise ArgumentError(
                f"local=trunk: the network does not take images of any size: {reason}",
                "Choose a network of convolutions, or local=xfeat.",
            ) from None
        if self.layers is not None:
            if wrong := [name for name in self.layers if name not in seen]:
                why = "are not in the network" if any(name not in known for name in wrong) else "give no map"
                raise ArgumentError(f"layers={wrong} {why}", f"Choose among {_some(seen)}.", of=self)
            return sorted(self.layers, key=lambda name: -seen[name].shape[3])
        staged = [name for name in seen if name.rpartition(".")[0].rpartition(".")[2] == "stages"]
        at: dict[int, str] = {}
        for name in staged or seen:  # in the order in which they ran
            stride = side // seen[name].shape[3]
            if stride in STRIDES and not (staged and stride in at):
                at[stride] = name
        if not at:
            raise ArgumentError(
                "local=trunk: the network has no maps at a quarter to a sixteenth of the image's sides",
                "Choose a network of convolutions, or local=xfeat.",
            )
        return [at[stride] for stride in STRIDES if stride in at]


def _some(seen: dict[str, Tensor], most: int = 8) -> str:
    """Names of maps, the shortest first, among those at most as fine as are used by default."""
    coarse = [name for name, each in seen.items() if each.shape[3] <= 8 * STRIDES[-1] // STRIDES[0]] or list(seen)
    return ", ".join(sorted(coarse, key=lambda name: (name.count("."), name))[:most])


@contextmanager
def _outputs(network: nn.Module, names: Sequence[str]) -> Any:
    """The outputs with height and width of modules while the network runs, in the order in which they ran."""
    seen: dict[str, Tensor] = {}

    def keep(name: str) -> Any:
        def hook(module: nn.Module, inputs: Any, output: Any) -> None:
            if isinstance(output, Tensor) and output.ndim == 4:
                seen.pop(name, None)
                seen[name] = output

        return hook

    hooks = [network.get_submodule(name).register_forward_hook(keep(name)) for name in names]
    try:
        yield seen
    finally:
        for hook in hooks:
            hook.remove()


def keypoints_of(
    maps: Sequence[Float[Tensor, "1 c h w"]], most: int
) -> tuple[Float[Tensor, "n 2"], Float[Tensor, "n d"]]:
    """Keypoints, the strongest first, in cells of the first map (x, y), and their descriptors of unit length."""
    rows, columns = maps[0].shape[2:]
    score = torch.zeros(1, 1, rows, columns)
    for each in maps:
        strongest = each.float().amax(1, keepdim=True)
        spread = strongest.std().clamp(min=1e-6)
        standard = (strongest - strongest.mean()) / spread
        score += F.interpolate(standard, (rows, columns), mode="bilinear", align_corners=False)
    peak = (score == F.max_pool2d(score, 3, 1, 1)) & (score > 0)
    peak[..., [0, -1], :] = False
    peak[..., [0, -1]] = False
    y, x = peak[0, 0].nonzero().T
    order = score[0, 0, y, x].argsort(descending=True, stable=True)[:most]
    y, x = y[order], x[order]
    shifts = [_vertex(*(score[0, 0, y + k * dy, x + k * dx] for k in (-1, 0, 1))) for dx, dy in ((1, 0), (0, 1))]
    points = torch.stack([x, y], 1) + torch.stack(shifts, 1)
    grid = ((points + 0.5) * 2 / torch.tensor([columns, rows]) - 1)[None, None]
    parts = [
        F.normalize(F.grid_sample(each.float(), grid, padding_mode="border", align_corners=False)[0, :, 0].T, dim=1)
        for each in maps
    ]
    return points, F.normalize(torch.cat(parts, 1), dim=1)


def _vertex(before: Tensor, here: Tensor, after: Tensor) -> Tensor:
    """Where the parabola through three neighbouring values of a maximum has its vertex, -0.5 to 0.5."""
    curvature = 2 * here - before - after
    return ((after - before) / (2 * curvature).clamp(min=1e-6)).clamp(-0.5, 0.5)


def trunk_of(parts: dict[str, nn.Module], channels: int) -> nn.Module:
    """Modules by name, one after the other, as a network of images of three channels, of whose mean it takes one."""
    first = {} if channels == 3 else {"grey": _Grey()}
    return nn.Sequential(OrderedDict(first | parts))


class _Grey(nn.Module):
    def forward(self, x: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b 1 h w"]:
        return x.mean(1, keepdim=True)
