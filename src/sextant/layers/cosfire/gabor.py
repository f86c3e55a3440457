r"""Gabor filters: detect bars and edges of a certain width and direction.

.. math:: g(x, y) = e^{-(u^2 + \gamma^2 v^2) / 2\sigma^2} \cos(2\pi u / \lambda + \varphi), \quad
    u = x\cos\theta + y\sin\theta,\; v = -x\sin\theta + y\cos\theta,\quad
    \sigma = \frac{\lambda}{\pi}\sqrt{\frac{\ln 2}{2}}\,\frac{2^b + 1}{2^b - 1}

with y upwards. Positive and negative parts are then scaled to equal weight, so that uniform brightness gives no
response.

Source: N. Petkov, "Biologically motivated computationally intensive approaches to image pattern recognition", Future
Generation Computer Systems 11, 1995; as in G. Azzopardi, N. Petkov, "Trainable COSFIRE filters for keypoint detection
and pattern recognition", PAMI 35, 2013.
"""

import math
from typing import Any

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from sextant.errors import UserError
from sextant.layers.cosfire.bank import SteerableBank, check_grey
from sextant.layers.cosfire.border import Border, padded
from sextant.layers.cosfire.tolerance import Move


def gabor_kernel(
    wavelength: float,
    theta_rad: float,
    *,
    phase_rad: float = math.pi,
    bandwidth: float = 2.0,
    aspect: float = 0.5,
) -> Float[Tensor, "s s"]:
    """One kernel, in float64; its side is ``2 ceil(2.5 sigma / aspect) + 1``.

    >>> gabor_kernel(8.0, 0.0).shape
    torch.Size([27, 27])

    Args:
        wavelength: λ, in pixels.
        theta_rad: θ, the direction across the bars, counter-clockwise from the x axis.
        phase_rad: φ: 0 for bright bars, π for dark ones, ±π/2 for edges.
        bandwidth: b, in octaves.
        aspect: γ, below 1 for kernels longer than wide.
    """
    octaves = 2.0**bandwidth
    sigma = wavelength / math.pi * math.sqrt(math.log(2) / 2) * (octaves + 1) / (octaves - 1)
    reach = math.ceil(2.5 * sigma / aspect)
    line = torch.arange(-reach, reach + 1, dtype=torch.float64)
    x, y = line[None, :], -line[:, None]
    u = x * math.cos(theta_rad) + y * math.sin(theta_rad)
    v = -x * math.sin(theta_rad) + y * math.cos(theta_rad)
    kernel = torch.exp(-(u**2 + (aspect * v) ** 2) / (2 * sigma**2)) * torch.cos(
        2 * math.pi * u / wavelength + phase_rad
    )
    bright, dark = kernel.clamp(min=0), kernel.clamp(max=0)
    return bright / bright.sum() - dark / dark.sum()


class GaborBank(SteerableBank):
    """Half-wave rectified Gabor responses; a channel is (λ in pixels, θ in rad).

    >>> image = torch.ones(1, 1, 32, 32)
    >>> image[..., 15:17] = 0  # a dark upright bar
    >>> bank = GaborBank(wavelengths=(4.0,), orientations=4)
    >>> bank.grid()[bank.describe(image)[0, :, 16, 16].argmax()]  # λ and θ, the direction across it
    tensor([4., 0.], dtype=torch.float64)

    Args:
        wavelengths: λ of the grid.
        orientations: number of θ, evenly spaced over ``span_deg`` from 0.
        span_deg: 180 covers all directions of symmetric kernels (phase 0 or 180), edges need 360; None chooses between
            them.
        phase_deg: φ.
        bandwidth, aspect: see :func:`gabor_kernel`.
        border: how images continue beyond their border.

    Raises:
        ValueError: no wavelength, one that pixels cannot show (2 or less), no orientation, or a bandwidth or aspect
            that is not positive.
    """

    def __init__(
        self,
        wavelengths: tuple[float, ...] = (4.0,),
        orientations: int = 8,
        span_deg: float | None = None,
        phase_deg: float = 180.0,
        bandwidth: float = 2.0,
        aspect: float = 0.5,
        border: Border = "replicate",
    ):
        super().__init__()
        if not wavelengths or min(wavelengths) <= 2 or orientations < 1:
            raise ValueError(
                f"Gabor filters need wavelengths above 2 pixels and an orientation; got {wavelengths} "
                f"and {orientations}"
            )
        if bandwidth <= 0 or aspect <= 0:
            raise ValueError(f"bandwidth and aspect of Gabor filters must be positive, got {bandwidth} and {aspect}")
        self.wavelengths = tuple(float(length) for length in wavelengths)
        self.orientations, self.phase_deg = orientations, phase_deg
        self.symmetric = phase_deg % 180 == 0
        self.span_deg = float(span_deg if span_deg is not None else (180 if self.symmetric else 360))
        self.bandwidth, self.aspect, self.border = bandwidth, aspect, border

    def grid(self) -> Float[Tensor, "k 2"]:
        """Every wavelength in every orientation."""
        turns = [math.radians(self.span_deg * turn / self.orientations) for turn in range(self.orientations)]
        return torch.tensor([[length, theta] for length in self.wavelengths for theta in turns], dtype=torch.float64)

    def describe(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k h w"]:
        """Responses of the grid; see :meth:`Bank.describe`."""
        return self(images, self.grid())  # type: ignore[no-any-return]

    def forward(self, images: Float[Tensor, "b c h w"], channels: Float[Tensor, "u 2"]) -> Float[Tensor, "b u h w"]:
        """Rectified responses; see :meth:`Bank.forward`."""
        check_grey(images, "GaborBank")
        wavelengths, members = torch.unique(channels[:, 0], return_inverse=True)
        found = images.new_zeros(len(images), len(channels), *images.shape[2:])
        for index, wavelength in enumerate(wavelengths.tolist()):
            rows = (members == index).nonzero()[:, 0]
            kernels = torch.stack([self._kernel(wavelength, float(theta)) for theta in channels[rows, 1]])
            reach = kernels.shape[-1] // 2
            kernels = kernels[:, None].to(images)
            found[:, rows] = F.conv2d(padded(images, reach, self.border), kernels).clamp(min=0)
        return found

    def moved(self, channels: Float[Tensor, "n 2"], move: Move) -> Float[Tensor, "n 2"]:
        """λ grows with the image, θ turns with it; see :meth:`SteerableBank.moved`.

        Raises:
            UserError: the smaller image needs a wavelength that pixels cannot show.
        """
        if len(channels) and float(channels[:, 0].min()) * move.scale <= 2:
            raise UserError(
                f"at scale {move.scale:g} Gabor filters have wavelengths down to "
                f"{float(channels[:, 0].min()) * move.scale:g} pixels, and must be above 2",
                "Tolerate fewer small scales, or give the bank longer wavelengths.",
            )
        theta = math.pi - channels[:, 1] if move.mirrored else channels[:, 1]
        whole = math.pi if self.symmetric else 2 * math.pi
        return torch.stack([channels[:, 0] * move.scale, (theta + move.rotation_rad) % whole], 1)

    def options(self) -> dict[str, Any]:
        """Arguments of the constructor."""
        names = ("wavelengths", "orientations", "span_deg", "phase_deg", "bandwidth", "aspect", "border")
        return {name: getattr(self, name) for name in names}

    def _kernel(self, wavelength: float, theta_rad: float) -> Tensor:
        return gabor_kernel(
            wavelength,
            theta_rad,
            phase_rad=math.radians(self.phase_deg),
            bandwidth=self.bandwidth,
            aspect=self.aspect,
        )
