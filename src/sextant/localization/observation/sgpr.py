r"""Sparse Gaussian process regression: the optimal summary of a map at M inducing poses, in closed form.

.. math:: \Lambda = I + L_{uu}^{-1} K_{uf} K_{fu} L_{uu}^{-\top} / s_n^2, \qquad
   \log p(Y) \ge \log N(\bar Y;\, 0,\, Q_{ff} + s_n^2 I) - \frac{D}{2 s_n^2} \operatorname{tr}(K_{ff} - Q_{ff}),
   \quad Q_{ff} = K_{fu} K_{uu}^{-1} K_{uf}

Of all Gaussian posteriors at the inducing poses, it is the nearest to the true posterior in Kullback-Leibler
divergence. One factorisation serves all D outputs. Fitting takes O(n M² + n M D) time, and each pose O(M² + M D).

Source: M. Titsias, "Variational learning of inducing variables in sparse Gaussian processes", AISTATS 2009.
"""

import torch
from torch import Tensor

from sextant.localization.observation._inducing import InducingRegression
from sextant.localization.observation.model import stored


class SGPR(InducingRegression):
    """The variational sparse Gaussian process, fitted in closed form. Arguments and errors are those of its base class.

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
