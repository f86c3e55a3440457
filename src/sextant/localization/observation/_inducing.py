r"""Inducing poses, at which a sparse Gaussian process summarises a map, and the features that they define.

.. math:: \phi(x) = L_{uu}^{-1} k_u(x), \qquad L_{uu} L_{uu}^\top = K_{uu}

so that :math:`\phi(x)^\top \phi(x')` is the Nyström approximation of the kernel. As the posterior covariance S of the
weights W is at most I, a prediction takes a single product with the covariances :math:`k_u(x)`:

.. math:: [\mu(x) - m,\; e] = k_u(x)^\top L_{uu}^{-\top} [W,\; C], \qquad C C^\top = I - S, \qquad
   s^2(x) = s_f^2 - \|e\|^2 + s_n^2
"""

from abc import abstractmethod
from typing import Literal

import torch
from jaxtyping import Float64
from sklearn.cluster import MiniBatchKMeans
from torch import Tensor

from sextant.errors import ArgumentError, UserError
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.observation._factor import check_noise, noisy_variance
from sextant.localization.observation._feature_regression import FeatureRegression
from sextant.localization.observation.model import Prediction, stored
from sextant.localization.pose_kernel import PoseKernel
from sextant.ranges import Count, Seed, checked

Placement = Literal["kmeans", "every"]
#: Jitter for the diagonal, as shares of the signal variance; the first that allows the factorisation is used.
JITTER = (0.0, 1e-12, 1e-10, 1e-8, 1e-6)
#: Batch size of the clustering, in map poses.
KMEANS_BATCH = 1024


class InducingRegression(FeatureRegression):
    """A model whose features come from M inducing poses; subclasses find the posterior at them.

    Args:
        inducing: M, at most the number of images in the map.
        placement: ``kmeans`` puts them at the centres of clusters of map poses in the kernel's own metric; ``every``
            takes map poses at equal steps. If M is the number of images, both take the map's poses.
        seed: seed of the clustering.

    Raises:
        UserError: fewer than one inducing pose; an unknown placement.
    """

    inducing_poses: Float64[Tensor, "m 3"]
    _factor: Float64[Tensor, "m m"]
    _projection: Float64[Tensor, "m d_and_m"]

    @checked
    def __init__(self, inducing: Count, placement: Placement = "kmeans", seed: Seed = 0):
        self.inducing, self.placement, self.seed = inducing, placement, seed

    @property
    def size(self) -> int:
        """The number of inducing poses."""
        return self.inducing

    def _fit(self) -> None:
        check_noise(self.kernel, type(self).__name__)
        self.inducing_poses = inducing_poses(self.map, self.kernel, self.inducing, self.placement, self.seed)
        self._factor = factor_of(self.kernel, self.inducing_poses).contiguous()
        self._fit_posterior()
        least, axes = torch.linalg.eigh(self.root @ self.root.T)
        explained = axes * (1 - least).clamp(min=0).sqrt()
        together = torch.cat([self.weights, explained], dim=1)
        self._projection = torch.linalg.solve_triangular(self._factor.T, together, upper=True).contiguous()

    @abstractmethod
    def _fit_posterior(self) -> None:
        """Set ``weights`` and ``root``; the features are available."""

    def features_at(self, poses: Float64[Tensor, "n 3"]) -> Float64[Tensor, "n f"]:
        """See the module's equation."""
        across = self.kernel(self.inducing_poses, poses)
        features: Tensor = torch.linalg.solve_triangular(self._factor, across, upper=False).T
        return features

    def predict(self, poses: Float64[Tensor, "n 3"]) -> Prediction:
        """See :class:`~sextant.localization.observation.model.ObservationModel`."""
        projected = self.kernel(poses, self.inducing_poses) @ self._projection
        known = projected[:, self.map.dimension :].square().sum(1)
        return Prediction(self.map.mean + projected[:, : self.map.dimension], noisy_variance(self.kernel, known))

    def state(self) -> dict[str, Tensor]:
        """See :class:`~sextant.localization.observation.model.ObservationModel`."""
        return {
            "inducing_poses": self.inducing_poses,
            "factor": self._factor,
            "weights": self.weights,
            "root": self.root,
            "projection": self._projection,
        }

    def _load(self, state: dict[str, Tensor]) -> None:
        size = self.inducing
        self.inducing_poses = stored(state, "inducing_poses", (size, 3))
        self._factor, self.root = stored(state, "factor", (size, size)), stored(state, "root", (size, size))
        self.weights = stored(state, "weights", (size, self.map.dimension))
        self._projection = stored(state, "projection", (size, self.map.dimension + size))


def inducing_poses(
    map: DescriptorMap, kernel: PoseKernel, inducing: int, placement: Placement = "kmeans", seed: int = 0
) -> Float64[Tensor, "m 3"]:
    """Poses that represent those of a map.

    Raises:
        UserError: more inducing poses are requested than the map has images.
    """
    if inducing > len(map):
        raise ArgumentError(
            f"inducing={inducing} must be at most the {len(map)} images of the map",
            f"Set inducing={len(map)} or less, or choose ExactGP.",
        )
    if inducing == len(map):
        return map.poses.clone()
    if placement == "every":
        return map.poses[torch.arange(inducing) * len(map) // inducing].clone()
    clusters = MiniBatchKMeans(inducing, batch_size=KMEANS_BATCH, n_init=1, random_state=seed)
    clusters.fit(kernel.features(map.poses).numpy())
    centres = torch.from_numpy(clusters.cluster_centers_).double()
    scale = torch.tensor(kernel.length, dtype=torch.float64)
    return torch.cat([centres[:, :2] * scale, torch.atan2(centres[:, 3:], centres[:, 2:3])], dim=1)


def factor_of(kernel: PoseKernel, poses: Float64[Tensor, "m 3"]) -> Float64[Tensor, "m m"]:
    """The lower Cholesky factor of the poses' covariance, with as little jitter as it needs.

    Raises:
        UserError: no jitter that is small against the signal's variance is enough.
    """
    covariance = kernel(poses, poses)
    for jitter in JITTER:
        eye = jitter * kernel.signal_variance * torch.eye(len(poses), dtype=torch.float64)
        factor: Tensor
        factor, failed = torch.linalg.cholesky_ex(covariance + eye)
        if not failed:
            return factor
    raise UserError(
        f"the covariance of {len(poses)} inducing poses cannot be factorised: they are too close together",
        "Use fewer inducing poses, or shorten the kernel's lengths.",
    )
