r"""Stochastic variational Gaussian process: the sparse posterior, fitted on minibatches of the map.

The posterior at the inducing poses is :math:`N(w_d; W_d, \Lambda^{-1})` in whitened coordinates, one covariance for all
D outputs. For Gaussian noise the natural gradient of the bound is linear in the data, so a step of length
:math:`\rho_t` moves the natural parameters towards their estimate from a minibatch B,

.. math:: \Lambda \leftarrow (1 - \rho_t) \Lambda + \rho_t \Big(I + \tfrac{n}{|B| s_n^2} \Phi_B^\top \Phi_B\Big), \qquad
   \Lambda W \leftarrow (1 - \rho_t) \Lambda W + \rho_t \tfrac{n}{|B| s_n^2} \Phi_B^\top \bar Y_B, \qquad
   \rho_t = (t + 1)^{-\kappa}

and for :math:`\kappa \in (1/2, 1]` this converges to SGPR with the same inducing poses. :math:`\kappa = 1` gives the
plain mean over minibatches, and no other value has less variance; smaller ones forget earlier minibatches, which is
useful where a map changes. Inducing poses and hyper-parameters stay fixed: the latter are trained beforehand, as for
all models.

Source: J. Hensman, N. Fusi, N. D. Lawrence, "Gaussian processes for big data", UAI 2013.
"""

from typing import Annotated

import torch
from annotated_types import Gt, Le
from torch import Tensor

from sextant.localization.observation._inducing import InducingRegression, Placement
from sextant.ranges import Count, Seed, checked


class SVGP(InducingRegression):
    """The variational sparse Gaussian process, fitted from minibatches by natural gradients.

    Args:
        inducing: as for the base class.
        steps: number of minibatches.
        batch: number of images in a minibatch; the whole map if it has fewer.
        forgetting: :math:`\\kappa` in (0.5, 1].
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

    @checked
    def __init__(
        self,
        inducing: Count,
        steps: Count = 200,
        batch: Count = 256,
        forgetting: Annotated[float, Gt(0.5), Le(1)] = 1.0,
        placement: Placement = "kmeans",
        seed: Seed = 0,
    ):
        super().__init__(inducing, placement, seed)
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
