r"""Differences of Gaussians: detect spots and lines of a certain width, in any direction.

.. math:: r_{\pm} = \max(0,\; \pm (g_{\sigma/2} - g_\sigma) * I)

on a support of ``2 ceil(3 sigma) + 1`` pixels, each Gaussian summing to one on it.

Source: G. Azzopardi, N. Strisciuglio, M. Vento, N. Petkov, "Trainable COSFIRE filters for vessel delineation with
application to retinal images", Medical Image Analysis 19, 2015.
"""

import math
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from sextant.layers.cosfire.bank import SteerableBank, check_grey
from sextant.layers.cosfire.blur import gaussian_line, twice_convolved
from sextant.layers.cosfire.border import Border, padded
from sextant.layers.cosfire.tolerance import Move


class DoGBank(SteerableBank):
    """Half-wave rectified differences of Gaussians; a channel is (σ in pixels, polarity).

    >>> spot = torch.zeros(1, 1, 21, 21)
    >>> spot[..., 9:12, 9:12] = 1
    >>> DoGBank(sigmas=(2.4,), polarities=(1, -1)).describe(spot)[0, :, 10, 10] > 0  # bright, not dark
    tensor([ True, False])

    Args:
        sigmas: σ of the outer Gaussian.
        polarities: 1 for a bright centre, -1 for a dark one.
        ratio: inner σ over outer σ.
        border: how images continue beyond their border.

    Raises:
        ValueError: no σ, one that is not positive, or a polarity that is neither 1 nor -1.
    """

    def __init__(
        self,
        sigmas: tuple[float, ...] = (2.4,),
        polarities: tuple[int, ...] = (1,),
        ratio: float = 0.5,
        border: Border = "replicate",
    ):
        super().__init__()
        if not sigmas or min(sigmas) <= 0 or not polarities or not {*polarities} <= {1, -1}:
            raise ValueError(f"DoG needs positive sigmas and polarities of 1 or -1; got {sigmas} and {polarities}")
        self.sigmas, self.polarities, self.ratio = tuple(float(s) for s in sigmas), tuple(polarities), ratio
        self.border = border

    def grid(self) -> Float[Tensor, "k 2"]:
        """Every polarity of every σ."""
        return torch.tensor([[s, sign] for s in self.sigmas for sign in self.polarities], dtype=torch.float64)

    def describe(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k h w"]:
        """Responses of the grid; see :meth:`Bank.describe`."""
        return self(images, self.grid())  # type: ignore[no-any-return]

    def forward(self, images: Float[Tensor, "b c h w"], channels: Float[Tensor, "u 2"]) -> Float[Tensor, "b u h w"]:
        """Rectified responses; see :meth:`Bank.forward`."""
        check_grey(images, "DoGBank")
        found = images.new_zeros(len(images), len(channels), *images.shape[2:])
        for sigma in torch.unique(channels[:, 0]).tolist():
            reach = math.ceil(3 * sigma)
            image = padded(images, reach, self.border)
            inner, outer = (twice_convolved(image, gaussian_line(s, reach)) for s in (self.ratio * sigma, sigma))
            for row in (channels[:, 0] == sigma).nonzero()[:, 0].tolist():
                found[:, row] = (float(channels[row, 1]) * (inner - outer))[:, 0].clamp(min=0)
        return found

    def moved(self, channels: Float[Tensor, "n 2"], move: Move) -> Float[Tensor, "n 2"]:
        """σ grows with the image; see :meth:`SteerableBank.moved`."""
        return channels * torch.tensor([move.scale, 1.0], dtype=channels.dtype)

    def options(self) -> dict[str, Any]:
        """Arguments of the constructor."""
        return {name: getattr(self, name) for name in ("sigmas", "polarities", "ratio", "border")}
