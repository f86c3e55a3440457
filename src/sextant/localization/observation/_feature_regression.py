r"""Bayesian linear regression on features of the pose: a Gaussian process of limited rank.

.. math:: \mu(x) = m + W^\top \phi(x), \qquad
   s^2(x) = s_f^2 - \|\phi(x)\|^2 + \phi(x)^\top S\, \phi(x) + s_n^2

with weights whose prior is N(0, I) and whose posterior covariance S is shared by all D outputs:

.. math:: \Lambda = I + \Phi^\top \Phi / s_n^2, \quad S = \Lambda^{-1}, \quad
   W = \Lambda^{-1} \Phi^\top \bar Y / s_n^2

One factorisation of the M x M matrix :math:`\Lambda` serves all outputs, and the map is read in blocks, so memory is
O(M² + M D) whatever the size of the map. :math:`s_f^2 - \|\phi\|^2` is the variance that the features cannot express;
it is 0 for random features.

Source: C. E. Rasmussen and C. K. I. Williams, "Gaussian Processes for Machine Learning", 2006, sections 2.1 and 8.
"""

from abc import abstractmethod

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.localization.observation.model import ObservationModel, Prediction

#: Feature values that are held at a time: 32 MiB.
ENTRIES = 2**22


class FeatureRegression(ObservationModel):
    """An observation model that is linear in :meth:`features_at`; ``weights`` and ``root`` are set by fitting.

    ``root`` is upper triangular, with :math:`S = R R^\\top`.
    """

    weights: Float64[Tensor, "f d"]
    root: Float64[Tensor, "f f"]

    @abstractmethod
    def features_at(self, poses: Float64[Tensor, "n 3"]) -> Float64[Tensor, "n f"]:
        """The features, whose inner products give the covariance."""

    @property
    @abstractmethod
    def size(self) -> int:
        """The number of features."""

    def predict(self, poses: Float64[Tensor, "n 3"]) -> Prediction:
        """See :class:`ObservationModel`."""
        features = self.features_at(poses)
        left_out = (self.kernel.signal_variance - features.square().sum(1)).clamp(min=0)
        variance = left_out + (features @ self.root).square().sum(1) + self.kernel.noise_variance
        return Prediction(self.map.mean.double() + features @ self.weights, variance)

    def regress(self) -> None:
        """Set ``weights`` and ``root`` from the whole map, read in blocks."""
        gram = torch.zeros(self.size, self.size, dtype=torch.float64)
        cross = torch.zeros(self.size, self.map.dimension, dtype=torch.float64)
        rows = max(1, ENTRIES // max(self.size, self.map.dimension))
        for poses, descriptors in zip(self.map.poses.split(rows), self.map.descriptors.split(rows), strict=True):
            features = self.features_at(poses)
            gram += features.T @ features
            cross += features.T @ (descriptors - self.map.mean).double()
        noise = self.kernel.noise_variance
        self.solve(torch.eye(self.size, dtype=torch.float64) + gram / noise, cross / noise)

    def solve(self, precision: Float64[Tensor, "f f"], linear: Float64[Tensor, "f d"]) -> None:
        """Set ``weights`` and ``root`` from the posterior's :math:`\\Lambda` and :math:`\\Lambda W`."""
        factor = torch.linalg.cholesky(precision)
        eye = torch.eye(self.size, dtype=torch.float64)
        self.root = torch.linalg.solve_triangular(factor.T, eye, upper=True).contiguous()
        self.weights = (self.root @ (self.root.T @ linear)).contiguous()
