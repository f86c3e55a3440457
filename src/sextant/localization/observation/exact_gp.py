r"""Exact Gaussian-process regression from poses to descriptors.

All D dimensions share one covariance, so one Cholesky factor :math:`L L^T = K + s_n^2 I` serves them all:

.. math:: A = (K + s_n^2 I)^{-1} (Y - 1 m^T), \quad \mu(x) = m + A^T k_x, \quad
   s^2(x) = s_f^2 - \|L^{-1} k_x\|^2 + s_n^2.

Source: C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning", MIT Press 2006, algorithm 2.1; as
a sensor model of a particle filter: J. Ko, D. Fox, "GP-BayesFilters", Autonomous Robots 27, 2009.
"""

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.localization.observation._factor import noisy_factor, noisy_variance
from sextant.localization.observation.model import ObservationModel, Prediction, stored

#: Covariances between poses and map that are held at a time: 32 MiB in float64.
ENTRIES = 2**22


class ExactGP(ObservationModel):
    """The posterior given the whole map: cubic in the number of images, and the reference for all other models.

    Args:
        max_images: largest number of images n in a map. Beyond it fitting, which takes ``16 n^2`` bytes and ``n^3 / 3``
            operations, is refused.

    Example:
        >>> from sextant.localization.descriptor_map import DescriptorMap
        >>> from sextant.localization.pose_kernel import PoseKernel
        >>> poses = torch.tensor([[0.0, 0, 0], [4, 0, 0]], dtype=torch.float64)
        >>> places = DescriptorMap.of(poses, torch.tensor([[1.0], [3.0]]))
        >>> model = ExactGP().fit(places, PoseKernel("rbf", (1.0, 1.0), 1.0, 1.0, 0.01))
        >>> predicted = model.predict(torch.tensor([[0.0, 0, 0], [99, 0, 0]], dtype=torch.float64))
        >>> predicted.mean.flatten(), predicted.variance  # at an image, and far off: the mean and the prior
        (tensor([1.0099, 2.0000], dtype=torch.float64), tensor([0.0199, 1.0100], dtype=torch.float64))
    """

    def __init__(self, max_images: int = 10_000):
        self.max_images = max_images

    def _fit(self) -> None:
        n = len(self.map)
        if n > self.max_images:
            raise ArgumentError(
                f"the map has {n} images, more than max_images={self.max_images} that an exact Gaussian "
                f"process may take: it would need {16e-9 * n * n:.1f} GB",
                "Choose CachedLocalGP, thin the map, or raise max_images.",
            )
        factor = noisy_factor(self.kernel(self.map.poses, self.map.poses), self.kernel.noise_variance)
        centred = (self.map.descriptors - self.map.mean).double()
        self.weights = torch.cholesky_solve(centred, factor).contiguous()
        self.factor = factor.contiguous()  # the layout in which it is loaded: another would round differently

    def predict(self, poses: Float64[Tensor, "n 3"]) -> Prediction:
        """See :class:`ObservationModel`."""
        means, variances = [], []
        for some in poses.split(max(1, ENTRIES // len(self.map))):
            covariance = self.kernel(self.map.poses, some)
            means.append(self.map.mean + covariance.T @ self.weights)
            known = torch.linalg.solve_triangular(self.factor, covariance, upper=False)
            variances.append(noisy_variance(self.kernel, known.square().sum(dim=0)))
        return Prediction(torch.cat(means), torch.cat(variances))

    def state(self) -> dict[str, Tensor]:
        """See :class:`ObservationModel`."""
        return {"factor": self.factor, "weights": self.weights}

    def _load(self, state: dict[str, Tensor]) -> None:
        n, d = self.map.descriptors.shape
        self.factor, self.weights = stored(state, "factor", (n, n)), stored(state, "weights", (n, d))
