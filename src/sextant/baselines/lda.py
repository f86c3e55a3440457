r"""Linear discriminant analysis with places as classes."""

from numpy import ndarray

from sextant.baselines.paired_descriptor import PairedDescriptor, ridge


class LDA(PairedDescriptor):
    r"""The directions in which places differ most relative to how much one place differs between two conditions.

    With components :math:`a_i, b_i` of place i in the two conditions, each of mean 0,

    .. math:: W = \tfrac{1}{4n} \sum_i (a_i - b_i)(a_i - b_i)^\top, \quad
       B = \tfrac{1}{4n} \sum_i (a_i + b_i)(a_i + b_i)^\top, \qquad B v = \lambda (W + \gamma \bar W I) v,

    where :math:`\bar W = \operatorname{tr} W / p`. The vectors v of the largest λ, of norm one in
    :math:`W + \gamma \bar W I`, map both conditions. The descriptor is scaled to norm one.

    Source: J. H. Friedman, "Regularized discriminant analysis", JASA 1989, for the ridge; Fisher's criterion.

    Args:
        height, width, dimensions, components: as for :class:`PairedDescriptor`.
        shrinkage: γ, above 0.

    Example:
        >>> import numpy as np
        >>> day = np.random.default_rng(0).integers(0, 200, (20, 8, 8, 1), dtype=np.uint8)
        >>> night = day // 3  # the same places, darker
        >>> lda = LDA(8, 8, dimensions=4, components=8).fit_pairs(day, night)
        >>> bool((lda.describe(day) * lda.describe_query(night)).sum(1).min() > 0.99)  # cosines of a place with itself
        True
    """

    def __init__(
        self,
        height: int = 32,
        width: int = 64,
        dimensions: int = 128,
        components: int = 256,
        shrinkage: float = 0.3,
    ):
        super().__init__(height, width, dimensions, components)
        self.shrinkage = shrinkage

    def learn_maps(self, reference: ndarray, query: ndarray) -> tuple[ndarray, ndarray]:
        """Discriminant directions, the same for both conditions."""
        from scipy.linalg import eigh

        if not self.shrinkage > 0:
            raise ValueError(f"shrinkage={self.shrinkage} must be above 0")
        apart, together = reference - query, reference + query
        within = ridge(apart.T @ apart / (4 * len(apart)), self.shrinkage)
        between = together.T @ together / (4 * len(together))
        size = len(within)
        _, vectors = eigh(between, within, subset_by_index=(size - self.dimensions, size - 1))
        return vectors[:, ::-1], vectors[:, ::-1]
