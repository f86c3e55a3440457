"""Gaussian processes with inducing points: the collapsed bound, and the stochastic one."""

import math
from abc import abstractmethod
from typing import Literal

import torch
from jaxtyping import Float64
from sklearn.cluster import MiniBatchKMeans
from torch import Tensor

from sextant.errors import ArgumentError, UserError
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.observation._factor import noisy_variance
from sextant.localization.observation._feature_regression import ENTRIES, FeatureRegression
from sextant.localization.observation.model import stored
from sextant.localization.observation.prediction import Prediction
from sextant.localization.pose_kernel import PoseKernel

Placement = Literal["kmeans", "every"]
PLACEMENTS: tuple[Placement, ...] = ("kmeans", "every")
#: Jitter for the diagonal, as shares of the signal variance; the first that allows the factorisation is used.
JITTER = (0.0, 1e-12, 1e-10, 1e-8, 1e-6)
#: Batch size of the clustering, in map poses.
KMEANS_BATCH = 1024


class InducingRegression(FeatureRegression):
    r"""A model whose features come from M inducing poses; subclasses find the posterior at them.

    .. math:: \phi(x) = L_{uu}^{-1} k_u(x), \qquad L_{uu} L_{uu}^\top = K_{uu}

    so that :math:`\phi(x)^\top \phi(x')` is the Nyström approximation of the kernel. As the posterior covariance S of
    the weights W is at most I, a prediction takes a single product with the covariances :math:`k_u(x)`:

    .. math:: [\mu(x) - m,\; e] = k_u(x)^\top L_{uu}^{-\top} [W,\; C], \qquad C C^\top = I - S, \qquad
       s^2(x) = s_f^2 - \|e\|^2 + s_n^2

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

    def __init__(self, inducing: int, placement: Placement = "kmeans", seed: int = 0):
        if inducing < 1:
            raise ArgumentError(f"inducing={inducing} must be at least 1", "Set inducing=200.")
        if placement not in PLACEMENTS:
            raise ArgumentError(f"placement={placement} must be one of {', '.join(PLACEMENTS)}")
        self.inducing, self.placement, self.seed = inducing, placement, seed

    @property
    def size(self) -> int:
        """The number of inducing poses."""
        return self.inducing

    def _fit(self) -> None:
        self.check_noise()
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
        UserError: more inducing poses are asked for than the map has images.
    """
    if inducing > len(map):
        raise ArgumentError(
            f"inducing={inducing} must be at most the {len(map)} images of the map",
            f"Set inducing={len(map)} or less, or take ExactGP.",
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


class SGPR(InducingRegression):
    r"""The variational sparse Gaussian process, fitted in closed form.

    Arguments and errors are those of its base class.

    .. math:: \Lambda = I + L_{uu}^{-1} K_{uf} K_{fu} L_{uu}^{-\top} / s_n^2, \qquad
       \log p(Y) \ge \log N(\bar Y;\, 0,\, Q_{ff} + s_n^2 I) - \frac{D}{2 s_n^2} \operatorname{tr}(K_{ff} - Q_{ff}),
       \quad Q_{ff} = K_{fu} K_{uu}^{-1} K_{uf}

    Of all Gaussian posteriors at the inducing poses, it is the nearest to the true posterior in Kullback-Leibler
    divergence. One factorisation serves all D outputs. Fitting takes O(n M² + n M D) time, and each pose O(M² + M D).

    Source: M. Titsias, "Variational learning of inducing variables in sparse Gaussian processes", AISTATS 2009.

    With inducing poses at the map's own poses it is the exact Gaussian process.

    Example:
        >>> from sextant.localization.descriptor_map import DescriptorMap
        >>> from sextant.localization.observation import ExactGP
        >>> from sextant.localization.pose_kernel import PoseKernel
        >>> poses = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> places, kernel = DescriptorMap.of(poses, torch.rand(20, 4)), PoseKernel("rbf", (3.0, 3.0), 1.0, 1.0, 0.1)
        >>> exact = ExactGP().fit(places, kernel).log_marginal_likelihood()
        >>> SGPR(5).fit(places, kernel).elbo() < SGPR(10).fit(places, kernel).elbo() <= exact
        True
    """

    def _fit_posterior(self) -> None:
        moments, noise = self.moments(), self.kernel.noise_variance
        self.solve(torch.eye(self.size, dtype=torch.float64) + moments.gram / noise, moments.cross / noise)
        left_out = len(self.map) * self.kernel.signal_variance - float(moments.gram.trace())
        self._elbo = self.log_evidence(moments) - self.map.dimension / (2 * noise) * left_out

    def elbo(self) -> float:
        """The evidence lower bound on the log marginal likelihood of all outputs, in nats."""
        return self._elbo

    def state(self) -> dict[str, Tensor]:
        """See :class:`~sextant.localization.observation.model.ObservationModel`."""
        return super().state() | {"elbo": torch.tensor([self._elbo], dtype=torch.float64)}

    def _load(self, state: dict[str, Tensor]) -> None:
        super()._load(state)
        self._elbo = float(stored(state, "elbo", (1,)))


class SVGP(InducingRegression):
    r"""The variational sparse Gaussian process, fitted from minibatches by natural gradients.

    The posterior at the inducing poses is :math:`N(w_d; W_d, \Lambda^{-1})` in whitened coordinates, one covariance for
    all D outputs. For Gaussian noise the natural gradient of the bound is linear in the data, so a step of length
    :math:`\rho_t` moves the natural parameters towards their estimate from a minibatch B,

    .. math:: \Lambda \leftarrow (1 - \rho_t) \Lambda + \rho_t \Big(I + \tfrac{n}{|B| s_n^2} \Phi_B^\top \Phi_B\Big),
       \qquad \Lambda W \leftarrow (1 - \rho_t) \Lambda W + \rho_t \tfrac{n}{|B| s_n^2} \Phi_B^\top \bar Y_B, \qquad
       \rho_t = (t + 1)^{-\kappa}

    and for :math:`\kappa \in (1/2, 1]` this converges to SGPR with the same inducing poses. :math:`\kappa = 1` gives
    the plain mean over minibatches, and no other value has less variance; smaller ones forget, which is useful where a
    map changes. Inducing poses and hyper-parameters stay fixed: the latter are trained beforehand, as for all models.

    Source: J. Hensman, N. Fusi, N. D. Lawrence, "Gaussian processes for big data", UAI 2013.

    Args:
        inducing: as for the base class.
        steps: number of minibatches.
        batch: number of images in a minibatch; the whole map if it has fewer.
        forgetting: :math:`\kappa` in (0.5, 1].
        placement: as for the base class.
        seed: seed of the inducing poses and of the minibatches, which are drawn without replacement until the map is
            used up.

    Raises:
        UserError: a size is below 1, the forgetting rate is outside its range, or as for the base class.

    Example:
        >>> from sextant.localization.descriptor_map import DescriptorMap
        >>> from sextant.localization.observation import SGPR
        >>> from sextant.localization.pose_kernel import PoseKernel
        >>> poses = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> places, kernel = DescriptorMap.of(poses, torch.rand(20, 4)), PoseKernel("rbf", (3.0, 3.0), 1.0, 1.0, 0.1)
        >>> whole = SGPR(10).fit(places, kernel)
        >>> SVGP(10, steps=40, batch=5).fit(places, kernel).predict(poses).mean.allclose(whole.predict(poses).mean)
        True
    """

    def __init__(
        self,
        inducing: int,
        steps: int = 200,
        batch: int = 256,
        forgetting: float = 1.0,
        placement: Placement = "kmeans",
        seed: int = 0,
    ):
        super().__init__(inducing, placement, seed)
        for name, value in {"steps": steps, "batch": batch}.items():
            if value < 1:
                raise ArgumentError(f"{name}={value} must be at least 1", f"Set {name}=200.")
        if not 0.5 < forgetting <= 1:
            raise ArgumentError(
                f"forgetting={forgetting} must be above 0.5 and at most 1, or the steps do not converge",
                "Set forgetting=1.",
            )
        self.steps, self.batch, self.forgetting = steps, batch, forgetting

    def _fit_posterior(self) -> None:
        generator = torch.Generator().manual_seed(self.seed)
        eye = torch.eye(self.size, dtype=torch.float64)
        precision, linear = eye.clone(), torch.zeros(self.size, self.map.dimension, dtype=torch.float64)
        waiting: list[Tensor] = []
        for step in range(self.steps):
            if not waiting:
                waiting = list(torch.randperm(len(self.map), generator=generator).split(self.batch))
            rows = waiting.pop()
            features = self.features_at(self.map.poses[rows])
            residuals = (self.map.descriptors[rows] - self.map.mean).double()
            scale = len(self.map) / (len(rows) * self.kernel.noise_variance)
            rate = (step + 1) ** -self.forgetting
            precision.lerp_(eye + scale * features.T @ features, rate)
            linear.lerp_(scale * features.T @ residuals, rate)
        self.solve(precision, linear)

    def elbo(self) -> float:
        """The lower bound on the log marginal likelihood of all outputs in nats, over the whole map, in blocks."""
        n, outputs, noise = len(self.map), self.map.dimension, self.kernel.noise_variance
        squared = left = 0.0
        rows = max(1, ENTRIES // max(self.size, outputs))
        for poses, descriptors in zip(self.map.poses.split(rows), self.map.descriptors.split(rows), strict=True):
            predicted = self.predict(poses)
            squared += float((descriptors.double() - predicted.mean).square().sum())
            left += float((predicted.variance - noise).sum())
        expected = -0.5 * (n * outputs * math.log(2 * math.pi * noise) + (squared + outputs * left) / noise)
        log_determinant = float(2 * self.root.diagonal().log().sum())
        spread = float(self.root.square().sum()) - self.size - log_determinant
        return expected - 0.5 * (float(self.weights.square().sum()) + outputs * spread)
