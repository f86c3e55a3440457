r"""The contrastive loss over pairs: it pulls positives together and pushes negatives at least a margin apart.

.. math:: L = \tfrac12 \operatorname{mean}_{+} d^2 + \tfrac12 \operatorname{mean}_{-} \max(0, \alpha - d)^2

Each mean is over its own kind of pairs, since a batch has many times more negatives; the mean of no pairs is 0.

Source: R. Hadsell et al., "Dimensionality reduction by learning an invariant mapping", CVPR 2006.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.losses.place_loss import Pairing, PlaceLoss, PlaceLossOutput, as_relation, nothing, pairwise_distances


class ContrastiveLoss(PlaceLoss):
    """The contrastive loss; see the module. ``active`` is the share of negative pairs nearer than the margin.

    Args:
        margin: distance in the unit of the descriptors, above 0.

    Raises:
        UserError: the margin is not positive.

    Example:
        >>> descriptors, triplet = torch.tensor([[0.0], [0.4], [0.3]]), torch.tensor([[0, 1, 2]])
        >>> ContrastiveLoss(margin=0.5)(descriptors, triplet).value  # (0.4² + (0.5 - 0.3)²) / 2
        tensor(0.1000)
    """

    def __init__(self, *, margin: float = 0.5):
        super().__init__()
        if not 0 < margin < float("inf"):
            raise ArgumentError(f"margin={margin} must be above 0", "For example margin=0.5")
        self.margin = margin

    def forward(self, descriptors: Float[Tensor, "b d"], pairing: Pairing) -> PlaceLossOutput:
        """Loss of the pairs of a relation, or of those in triplets."""
        relation = as_relation(descriptors, pairing)
        if not bool((relation.positive | relation.negative).any()):
            return nothing(descriptors)
        apart = pairwise_distances(descriptors)
        near, far = apart[relation.positive], apart[relation.negative]
        short = (self.margin - far).clamp(min=0)
        value = torch.stack([_mean(near.square()), _mean(short.square())]).sum() / 2
        return PlaceLossOutput(value, _mean((far < self.margin).float()))


def _mean(values: Float[Tensor, "n"]) -> Float[Tensor, ""]:
    return values.sum() / max(1, len(values))
