"""The image's edges in place of the image."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int64
from skimage.feature import canny
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption
from sextant.corruptions.luma import luma


@dataclass(frozen=True)
class CannyEdges(BenchmarkCorruption[tuple[()], None]):
    """1 on the edges that Canny's detector finds, 0 elsewhere; every channel shows the edges of the luma.

    This is scikit-image's detector with its defaults (σ = 1, thresholds 0.1 and 0.2), as in the benchmark. Nothing is
    random, and there is one severity.

    Source: Mu & Gilmer, "MNIST-C: a robustness benchmark for computer vision", 2019, and its published code.

    >>> square = torch.zeros(1, 1, 16, 16)
    >>> square[..., 4:12, 4:12] = 1
    >>> CannyEdges(((),), "canny_edges")(square, level=1, indices=[0], seed=0)[0, 0, 7].nonzero().flatten()
    tensor([ 4, 11])
    """

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> None:
        """Nothing."""

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: None) -> Float[Tensor, "b c h w"]:
        """Find the edges, on the CPU whatever the device."""
        self.row(level)
        # grey levels as exact as 8-bit images have them: single precision would break ties between neighbours
        grey = np.round(luma(images)[:, 0].double().cpu().numpy() * 255, 3) / 255
        edges = np.stack([canny(one) for one in grey])
        return torch.from_numpy(edges)[:, None].to(images).expand_as(images).contiguous()
