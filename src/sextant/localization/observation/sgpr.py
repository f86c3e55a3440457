r"""Sparse Gaussian process regression: the optimal summary of a map at M inducing poses, in closed form.

.. math:: \Lambda = I + L_{uu}^{-1} K_{uf} K_{fu} L_{uu}^{-\top} / s_n^2, \qquad
   \log p(Y) \ge \log N(\bar Y;\, 0,\, Q_{ff} + s_n^2 I) - \frac{D}{2 s_n^2} \operatorname{tr}(K_{ff} - Q_{ff}),
   \quad Q_{ff} = K_{fu} K_{uu}^{-1} K_{uf}

Of all Gaussian posteriors at the inducing poses, it is the nearest to the true posterior in Kullback-Leibler
divergence. One factorisation serves all D outputs. Fitting takes O(n M² + n M D) time, and each pose O(M² + M D).

Source: M. Titsias, "Variational learning of inducing variables in sparse Gaussian processes", AISTATS 2009.
"""

from sextant.localization.observation._inducing import InducingRegression


class SGPR(InducingRegression):
    """The variational sparse Gaussian process, fitted in closed form. Arguments and errors are those of its base class.

    With inducing poses at the map's own poses it is the exact Gaussian process.

    Example:
        >>> import torch
        >>> from sextant.localization.descriptor_map import DescriptorMap
        >>> from sextant.localization.observation import ExactGP
        >>> from sextant.localization.pose_kernel import PoseKernel
        >>> poses = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> places, kernel = DescriptorMap.of(poses, torch.rand(20, 4)), PoseKernel("rbf", (3.0, 3.0), 1.0, 1.0, 0.1)
        >>> exact = ExactGP().fit(places, kernel).predict(poses)
        >>> SGPR(20).fit(places, kernel).predict(poses).mean.allclose(exact.mean)
        True
    """

    def _fit_posterior(self) -> None:
        self.regress()
