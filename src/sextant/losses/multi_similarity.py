r"""The multi-similarity loss.

With the cosine similarity :math:`s_{ij}`, the loss of anchor i is

.. math:: L_i = \frac1\alpha \log\Big(1 + \sum_{j \in +} e^{-\alpha (s_{ij} - \lambda)}\Big)
              + \frac1\beta \log\Big(1 + \sum_{j \in -} e^{\beta (s_{ij} - \lambda)}\Big),

averaged over all images of the batch, including those without a pair, whose loss is 0. Only informative pairs are
kept: positives less similar than the most similar negative plus :math:`\epsilon`, negatives more similar than the least
similar positive minus :math:`\epsilon`. Pairs are those of a relation, in which images may be ignored.

Source: X. Wang et al., "Multi-similarity loss with general pair weighting for deep metric learning", CVPR 2019.
"""

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.losses.place_loss import Pairing, PlaceLoss, PlaceLossOutput, as_relation, nothing
from sextant.retrieval import Relation


class MultiSimilarityLoss(PlaceLoss):
    """The multi-similarity loss; see the module. ``active`` is the share of the pairs that the mining keeps.

    Args:
        alpha: weight of positives, above 0.
        beta: weight of negatives, above 0.
        base: the similarity λ that positives should exceed and negatives stay below, in [-1, 1].
        epsilon: margin for the mining of pairs; None keeps all.

    Raises:
        UserError: a parameter is out of its range.

    Example:
        >>> descriptors = torch.tensor([[1.0, 0.0], [0.5, 0.75**0.5], [0.5, -(0.75**0.5)]])  # s = λ to either
        >>> MultiSimilarityLoss()(descriptors, torch.tensor([[0, 1, 2]])).value  # (ln 2 / 2 + ln 2 / 50) / 3 images
        tensor(0.1201)
    """

    def __init__(self, *, alpha: float = 2.0, beta: float = 50.0, base: float = 0.5, epsilon: float | None = 0.1):
        super().__init__()
        for name, value in (("alpha", alpha), ("beta", beta)):
            if not 0 < value < float("inf"):
                raise ArgumentError(f"{name}={value} must be above 0", "alpha=2 beta=50")
        if not -1 <= base <= 1:
            raise ArgumentError(f"base={base} must be in [-1, 1]", "For example base=0.5")
        if epsilon is not None and not 0 <= epsilon < float("inf"):
            raise ArgumentError(f"epsilon={epsilon} must be at least 0, or null", "For example epsilon=0.1")
        self.alpha, self.beta, self.base, self.epsilon = alpha, beta, base, epsilon

    def forward(self, descriptors: Float[Tensor, "b d"], pairing: Pairing) -> PlaceLossOutput:
        """Loss of the pairs of a relation, or of those in triplets."""
        relation = as_relation(descriptors, pairing)
        wide = descriptors.to(torch.promote_types(descriptors.dtype, torch.float32))
        kept = relation if self.epsilon is None else informative_pairs(wide, relation, self.epsilon)
        before, after = (int(pairs.positive.sum() + pairs.negative.sum()) for pairs in (relation, kept))
        if after == 0:
            return nothing(descriptors)
        unit = F.normalize(wide, dim=1)
        above = unit @ unit.T - self.base
        value = _log_of_one_plus_sum(-self.alpha * above, kept.positive) / self.alpha
        value = value + _log_of_one_plus_sum(self.beta * above, kept.negative) / self.beta
        return PlaceLossOutput(value.mean(), torch.tensor(after / before, device=descriptors.device))


def _log_of_one_plus_sum(exponents: Float[Tensor, "b b"], chosen: Bool[Tensor, "b b"]) -> Float[Tensor, "b"]:
    """Log of 1 plus the exponentials of each row's chosen entries, without overflow."""
    return torch.logsumexp(F.pad(exponents.masked_fill(~chosen, -torch.inf), (1, 0)), dim=1)


@torch.no_grad()
def informative_pairs(descriptors: Float[Tensor, "b d"], relation: Relation, epsilon: float) -> Relation:
    """The pairs that the multi-similarity loss learns from; anchors without positives or negatives have none."""
    unit = F.normalize(descriptors, dim=1)
    similarity = unit @ unit.T
    best_wrong = similarity.masked_fill(~relation.negative, -torch.inf).amax(1, keepdim=True)
    worst_right = similarity.masked_fill(~relation.positive, torch.inf).amin(1, keepdim=True)
    return Relation(
        relation.positive & (similarity < best_wrong + epsilon),
        relation.negative & (similarity > worst_right - epsilon),
    )
