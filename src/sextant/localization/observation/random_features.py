r"""Random Fourier features: the kernel as a mean of waves of random frequencies, and linear regression on them.

.. math:: k(x, x') \approx \phi(x)^\top \phi(x'), \qquad
   \phi(x) = s_f \sqrt{\tfrac 2R}\, \big[\cos(\omega_j^\top u),\ \sin(\omega_j^\top u)\big]_{j \le R/2}, \qquad
   u = (x, y, \cos\theta, \sin\theta)

The frequencies are drawn from the kernel's spectral density: for positions the normal distribution of variance
:math:`1/\ell^2` (RBF), or the t distribution of two dimensions with 2ν degrees of freedom (Matérn of smoothness ν); for
the circle the normal one of variance :math:`1/\ell_\theta^2`, as the factor of the heading is an RBF of its chord. With
cosine and sine in pairs, :math:`\phi^\top\phi = s_f^2` exactly, and the error of k falls as :math:`1/\sqrt R`.

A known weakness: with fewer features than the data have directions, the posterior variance is too small far from the
map, because R waves that are determined on the map are determined everywhere.

Sources: A. Rahimi and B. Recht, "Random features for large-scale kernel machines", NeurIPS 2007; D. J. Sutherland and
J. Schneider, "On the error of random Fourier features", UAI 2015, for the pairs.
"""

import math
from typing import Annotated

import torch
from annotated_types import Ge, MultipleOf
from jaxtyping import Float64
from torch import Generator, Tensor

from sextant.localization.observation._factor import check_noise
from sextant.localization.observation._feature_regression import FeatureRegression
from sextant.localization.observation.model import stored
from sextant.localization.pose_kernel import PoseKernel
from sextant.ranges import Seed, checked

#: Degrees of freedom of the spectral density, twice the smoothness of the kernel.
DOF = {"matern32": 3, "matern52": 5}


class RandomFeatures(FeatureRegression):
    """Bayesian linear regression on random Fourier features.

    Args:
        features: R, the number of features, which is even.
        seed: seed of the frequencies.

    Raises:
        UserError: the number of features is odd or below 2.

    Example:
        >>> from sextant.localization.descriptor_map import DescriptorMap
        >>> poses = torch.tensor([[0.0, 0, 0], [1, 0, 0]], dtype=torch.float64)
        >>> places, kernel = DescriptorMap.of(poses, torch.eye(2)), PoseKernel("rbf", (1.0, 1.0), 1.0, 1.0, 0.1)
        >>> features = RandomFeatures(1000).fit(places, kernel).features_at(poses)
        >>> (features @ features.T - kernel(poses, poses)).abs().max() < 0.1
        tensor(True)
    """

    frequencies: Float64[Tensor, "4 half"]

    @checked
    def __init__(self, features: Annotated[int, Ge(2), MultipleOf(2)] = 512, seed: Seed = 0):
        self.features, self.seed = features, seed

    @property
    def size(self) -> int:
        """The number of features."""
        return self.features

    def _fit(self) -> None:
        check_noise(self.kernel, type(self).__name__)
        generator = torch.Generator().manual_seed(self.seed)
        self.frequencies = spectral_frequencies(self.kernel, self.features // 2, generator)
        self.regress()

    def features_at(self, poses: Float64[Tensor, "n 3"]) -> Float64[Tensor, "n f"]:
        """See the module's equation."""
        heading = poses[:, 2:]
        phases = torch.cat([poses[:, :2], heading.cos(), heading.sin()], dim=1) @ self.frequencies
        scale = math.sqrt(2 * self.kernel.signal_variance / self.features)
        return scale * torch.cat([phases.cos(), phases.sin()], dim=1)

    def state(self) -> dict[str, Tensor]:
        """See :class:`~sextant.localization.observation.model.ObservationModel`."""
        return {"frequencies": self.frequencies, "weights": self.weights, "root": self.root}

    def _load(self, state: dict[str, Tensor]) -> None:
        self.frequencies = stored(state, "frequencies", (4, self.features // 2))
        self.weights = stored(state, "weights", (self.features, self.map.dimension))
        self.root = stored(state, "root", (self.features, self.features))


def spectral_frequencies(kernel: PoseKernel, number: int, generator: Generator) -> Float64[Tensor, "4 n"]:
    """Draws from the kernel's spectral density over (x, y, cos θ, sin θ), in rad per unit of each."""
    waves = torch.randn(4, number, generator=generator, dtype=torch.float64)
    if kernel.spatial != "rbf":
        dof = DOF[kernel.spatial]
        # a t variate is a normal one over the root of a mean of squares; x and y share one divisor
        squares = torch.randn(dof, number, generator=generator, dtype=torch.float64).square().mean(0)
        waves[:2] /= squares.sqrt()
    scale = torch.tensor([*kernel.length, kernel.heading_length, kernel.heading_length], dtype=torch.float64)
    return waves / scale[:, None]
