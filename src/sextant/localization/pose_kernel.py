r"""Positive definite covariance functions over poses in the plane, with headings that wrap.

.. math:: k(x, x') = s_f^2\; g(r)\; e^{-(1 - \cos(\theta - \theta')) / l_\theta^2}, \qquad
   r^2 = \frac{(x - x')^2}{l_x^2} + \frac{(y - y')^2}{l_y^2}

with :math:`g(r) = e^{-r^2/2}` (``rbf``), :math:`(1 + \sqrt3 r)\,e^{-\sqrt3 r}` (``matern32``) or
:math:`(1 + \sqrt5 r + \tfrac53 r^2)\,e^{-\sqrt5 r}` (``matern52``). As
:math:`|(\cos\theta, \sin\theta) - (\cos\theta', \sin\theta')|^2 = 2 - 2\cos(\theta - \theta')`, the factor of the
heading is the squared exponential on the circle, and with ``rbf`` the whole kernel is a squared exponential of the
features :math:`(x/l_x, y/l_y, \cos\theta/l_\theta, \sin\theta/l_\theta)`. A squared exponential of the wrapped angle
would not be positive definite.

Sources: C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning", MIT Press 2006, chapter 4; for
the periodic factor, D. J. C. MacKay, "Introduction to Gaussian processes", 1998. GPyTorch's length scale of that factor
is :math:`l_\theta^2`.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.errors import shown
from sextant.ranges import Positive, fits

Spatial = Literal["rbf", "matern32", "matern52"]
SPATIAL: tuple[Spatial, ...] = ("rbf", "matern32", "matern52")


@dataclass(frozen=True)
class PoseKernel:
    """A covariance function of poses with its hyper-parameters.

    Attributes:
        spatial: how covariance falls with distance.
        length: length scales of x and y in metres.
        heading_length: length scale on the unit circle, a chord: 1 is about 60 degrees.
        signal_variance: variance of one output dimension about the mean, :math:`s_f^2`.
        noise_variance: variance between images at one pose, :math:`s_n^2`; not part of the covariance.

    Example:
        >>> kernel = PoseKernel("rbf", (2.0, 2.0), heading_length=1.0, signal_variance=1.0, noise_variance=0.1)
        >>> there = torch.tensor([[0.0, 0, 2 * math.pi], [2, 0, 0], [0, 0, math.pi]], dtype=torch.float64)
        >>> kernel(torch.zeros(1, 3, dtype=torch.float64), there)  # a full turn is none; exp(-1/2); exp(-2)
        tensor([[1.0000, 0.6065, 0.1353]], dtype=torch.float64)
    """

    spatial: Spatial
    length: tuple[float, float]
    heading_length: float
    signal_variance: float
    noise_variance: float

    def __post_init__(self) -> None:
        if self.spatial not in SPATIAL:
            raise ValueError(f"spatial={self.spatial!r} must be one of {', '.join(SPATIAL)}")
        if not fits(tuple[Positive, Positive], self.length):
            raise ValueError(f"length={shown(self.length)} must be two numbers, above 0 and finite")
        for name, value in {"heading_length": self.heading_length, "signal_variance": self.signal_variance}.items():
            if not (value > 0 and math.isfinite(value)):
                raise ValueError(f"{name}={value} must be above 0 and finite")
        if not (self.noise_variance >= 0 and math.isfinite(self.noise_variance)):
            raise ValueError(f"noise_variance={self.noise_variance} must be at least 0 and finite")

    def sharpened(self, length: float, noise: float, heading: float = 1.0) -> "PoseKernel":
        """A kernel that smooths less from place to place.

        Args:
            length: factor of the lengths of x and y.
            noise: largest noise variance of the new kernel, as a share of the signal variance.
            heading: factor of the heading's length. A map of few headings hardly constrains how similar the views
                between them are. Where they are more similar than the kernel fitted to the map implies, a factor above
                1 helps.

        >>> PoseKernel("rbf", (4.0, 2.0), 0.5, 1.0, 0.6).sharpened(0.5, 0.001, heading=1.6)
        PoseKernel(spatial='rbf', length=(2.0, 1.0), heading_length=0.8, signal_variance=1.0, noise_variance=0.001)
        """
        x, y = self.length
        least = min(self.noise_variance, noise * self.signal_variance)
        return replace(
            self, length=(length * x, length * y), heading_length=heading * self.heading_length, noise_variance=least
        )

    def __call__(self, a: Float64[Tensor, "*#b n 3"], b: Float64[Tensor, "*#b m 3"]) -> Float64[Tensor, "*#b n m"]:
        """Covariance of the signal at poses a and b, without noise; batches are broadcast."""
        far_x = (a[..., :, None, 0] - b[..., None, :, 0]) / self.length[0]
        far_y = (a[..., :, None, 1] - b[..., None, :, 1]) / self.length[1]
        turned = torch.cos(a[..., :, None, 2] - b[..., None, :, 2])
        spatial = _falling(self.spatial, far_x * far_x + far_y * far_y)
        return self.signal_variance * spatial * torch.exp((turned - 1) / self.heading_length**2)

    def features(self, poses: Float64[Tensor, "*b 3"]) -> Float64[Tensor, "*b 4"]:
        r"""Points whose squared distance is :math:`r^2 + 2(1 - \cos\Delta\theta)/l_\theta^2`, to search for neighbours.

        With ``rbf`` this is :math:`-2 \log(k / s_f^2)`, so the nearest poses are those with the highest covariance.
        """
        x, y, heading = poses.unbind(-1)
        scaled = (x / self.length[0], y / self.length[1])
        circle = (torch.cos(heading) / self.heading_length, torch.sin(heading) / self.heading_length)
        return torch.stack([*scaled, *circle], dim=-1)


def _falling(spatial: Spatial, square: Tensor) -> Tensor:
    if spatial == "rbf":
        return torch.exp(-square / 2)
    if spatial == "matern32":
        scaled = torch.sqrt(3 * square)
        return (1 + scaled) * torch.exp(-scaled)
    scaled = torch.sqrt(5 * square)
    return (1 + scaled + scaled * scaled / 3) * torch.exp(-scaled)
