"""Spatter: drops of water or splashes of mud on the lens."""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import torch
from jaxtyping import Float, Float64, Int64
from numpy.typing import NDArray
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption, Mode
from sextant.corruptions.filtering.gaussian_filter import gaussian_filter

WATER = (175 / 255, 238 / 255, 238 / 255)  # pale turquoise
MUD = (63 / 255, 42 / 255, 20 / 255)  # brown
GREY_MUD = (63 / 255,)
RELIEF = np.array([[-2, -1, 0], [-1, 1, 1], [0, 1, 2]], np.float32)  # lit from one corner
REACH = 20  # pixels from an edge at which the distance saturates


class SpatterRow(NamedTuple):
    """One severity: mean, spread, smoothing, threshold of the liquid; strength (water) or blur (mud); whether mud."""

    mean: float
    spread: float
    sigma: float
    threshold: float
    strength: float
    mud: float


@dataclass(frozen=True)
class Spatter(BenchmarkCorruption[tuple[float, ...], Tensor]):
    """``y = x + m·water``, or ``y = (1 - m)·x + m·mud``, clipped to [0, 1].

    The liquid is smoothed normal noise, set to 0 below a threshold. Mud covers where there is liquid: ``m`` is that
    mask, smoothed and set to 0 below 0.8. Water shines by the relief of the distances to the liquid's edges (Canny),
    times the liquid, with its maximum scaled to the row's strength. An image of one channel gets mud at every severity,
    in the grey of MNIST-C, whose authors have no water.

    Source: Hendrycks & Dietterich, "Benchmarking neural network robustness", ICLR 2019, and its published code.

    >>> row = SpatterRow(mean=0.65, spread=0.3, sigma=2, threshold=0.65, strength=0.5, mud=1)
    >>> muddy = Spatter((row,), "spatter")(torch.ones(1, 3, 32, 32), level=1, indices=[0], seed=0)
    >>> muddy.amin((0, 2, 3)) * 255  # brown
    tensor([63., 42., 20.])

    Args:
        table: the values of :class:`SpatterRow` for each severity.
        mode: the modes differ only for liquid above 1: ``faithful`` lets it overflow its 8 bits as the benchmark does
            (in its tables this does not occur in practice), ``corrected`` saturates it. Both leave an image without a
            drop as it is; the benchmark divides 0 by 0 there.
    """

    mode: Mode = "faithful"

    def draw(
        self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int
    ) -> Float[Tensor, "b h w"]:
        """Standard normal noise from which the liquid is made."""
        noise = torch.empty(len(indices), *shape[-2:])
        for one, generator in zip(noise, self.streams(level, indices, seed), strict=True):
            one.normal_(generator=generator)
        return noise

    def apply(
        self, images: Float[Tensor, "b c h w"], level: float, params: Float[Tensor, "b h w"]
    ) -> Float[Tensor, "b c h w"]:
        """Cover the images with the drawn water or mud."""
        row, grey = SpatterRow(*self.row(level)), images.shape[1] == 1
        liquid = gaussian_filter(params.double().to(images.device)[:, None] * row.spread + row.mean, row.sigma)
        liquid = liquid.where(liquid >= row.threshold, 0)
        if grey or row.mud:
            cover = gaussian_filter((liquid > row.threshold).double(), row.strength)
            cover = cover.where(cover >= 0.8, 0).to(images)
            return (images * (1 - cover) + _colour(images, GREY_MUD if grey else MUD) * cover).clamp(0, 1)
        shine = self._shine(liquid[:, 0]).to(images)[:, None]
        return (images + row.strength * shine * _colour(images, WATER)).clamp(0, 1)

    def _shine(self, liquid: Float64[Tensor, "b h w"]) -> Float[Tensor, "b h w"]:
        levels = (liquid * 255).long()
        levels = levels & 255 if self.mode == "faithful" else levels.clamp(max=255)
        return torch.from_numpy(np.stack([_shine(one) for one in levels.to(torch.uint8).cpu().numpy()]))


def _shine(liquid: NDArray[np.uint8]) -> NDArray[np.float32]:
    """How bright one image's water is, its maximum 1: liquid times the relief of the distance to its edges."""
    distance = cv2.distanceTransform(255 - cv2.Canny(liquid, 50, 150), cv2.DIST_L2, 5)
    near = cv2.blur(np.minimum(distance, REACH), (3, 3)).astype(np.uint8)
    relief = cv2.blur(cv2.filter2D(cv2.equalizeHist(near), cv2.CV_8U, RELIEF), (3, 3))
    shine: NDArray[np.float32] = np.multiply(liquid, relief, dtype=np.float32)
    shine /= max(shine.max(), 1)  # without a drop no shine; with one, a product of whole numbers is at least 1
    return shine


def _colour(images: Float[Tensor, "b c h w"], colour: tuple[float, ...]) -> Float[Tensor, "1 c 1 1"]:
    return images.new_tensor(colour)[None, :, None, None]
