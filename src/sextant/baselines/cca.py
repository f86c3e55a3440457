r"""Canonical correlation analysis between two conditions."""

import numpy as np
from numpy import ndarray

from sextant.baselines.paired_descriptor import PairedDescriptor, ridge


class CCA(PairedDescriptor):
    r"""One map for each condition, such that the two descriptors of a place agree.

    With covariances :math:`C_{aa}, C_{bb}, C_{ab}` of the components, where each covariance of one condition is lifted
    by γ times its mean variance, and the singular value decomposition

    .. math:: C_{aa}^{-1/2} C_{ab} C_{bb}^{-1/2} = U R V^\top, \qquad
       A = C_{aa}^{-1/2} U R^{\alpha}, \quad B = C_{bb}^{-1/2} V R^{\alpha},

    R holds the canonical correlations, largest first, of which ``dimensions`` are kept. α = 1/2 is the posterior mean
    of the latent variable of probabilistic CCA; α = 0 weights all alike. Inverse roots are taken by Cholesky factors.
    The descriptor is scaled to norm one.

    Sources: H. Hotelling, Biometrika 1936; H. D. Vinod, "Canonical ridge", Journal of Econometrics 1976; F. Bach and
    M. Jordan, "A probabilistic interpretation of canonical correlation analysis", 2005.

    Args:
        height, width, dimensions, components: as for :class:`PairedDescriptor`.
        shrinkage: γ, above 0.
        weighting: α, at least 0.

    Example:
        >>> day = np.random.default_rng(0).integers(0, 200, (20, 8, 8, 1), dtype=np.uint8)
        >>> night = 255 - day  # the same places as negatives
        >>> cca = CCA(8, 8, dimensions=4, components=8).fit_pairs(day, night)
        >>> bool((cca.describe(day) * cca.describe_query(night)).sum(1).min() > 0.99)  # cosines of a place with itself
        True
    """

    def __init__(
        self,
        height: int = 32,
        width: int = 64,
        dimensions: int = 128,
        components: int = 256,
        shrinkage: float = 0.1,
        weighting: float = 0.5,
    ):
        super().__init__(height, width, dimensions, components)
        self.shrinkage, self.weighting = shrinkage, weighting

    def learn_maps(self, reference: ndarray, query: ndarray) -> tuple[ndarray, ndarray]:
        """Canonical directions of each condition; ``correlations_`` are those of the lifted covariances."""
        from scipy.linalg import solve_triangular, svd

        if not self.shrinkage > 0 or not self.weighting >= 0:
            raise ValueError(f"shrinkage={self.shrinkage} must be above 0, weighting={self.weighting} at least 0")
        count = len(reference)
        first, second = (
            np.linalg.cholesky(ridge(each.T @ each / count, self.shrinkage)) for each in (reference, query)
        )
        half = solve_triangular(first, reference.T @ query / count, lower=True)
        left, correlations, right = svd(solve_triangular(second, half.T, lower=True).T)
        kept = slice(self.dimensions)
        self.correlations_ = correlations[kept]
        weights = correlations[kept] ** self.weighting
        return (
            solve_triangular(first.T, left[:, kept]) * weights,
            solve_triangular(second.T, right[kept].T) * weights,
        )
