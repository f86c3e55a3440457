r"""InfoNCE: the negative log of the probability that an anchor's likeliest image shows its place.

With the cosine similarity :math:`s_{ij}` and temperature T, for every anchor i with a positive and a negative

.. math:: L_i = -\log \frac{\sum_{j \in +} e^{s_{ij}/T}}{\sum_{j \in + \cup -} e^{s_{ij}/T}} .

Ignored pairs are in neither sum. Evaluated on a whole traverse this is the negative log-likelihood of the place.

Sources: A. van den Oord et al., "Representation learning with contrastive predictive coding", 2018; the sum over
several positives within the logarithm is from A. Miech et al., "End-to-end learning of visual representations from
uncurated instructional videos", CVPR 2020.
"""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.losses.place_loss import Pairing, PlaceLoss, PlaceLossOutput, as_relation, nothing


class InfoNCELoss(PlaceLoss):
    """InfoNCE over the pairs of a batch; see the module.

    ``active`` is the share of anchors with a negative at least as similar as all their positives.

    Args:
        temperature: T, above 0.

    Raises:
        UserError: the temperature is not positive.

    Example:
        >>> anchor_positive_negative = torch.tensor([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])
        >>> InfoNCELoss()(anchor_positive_negative, torch.tensor([[0, 1, 2]])).value  # equally similar: ln 2
        tensor(0.6931)
    """

    def __init__(self, *, temperature: float = 0.07):
        super().__init__()
        if not 0 < temperature < float("inf"):
            raise ArgumentError(f"temperature={temperature} must be above 0", "For example temperature=0.07")
        self.temperature = temperature

    def forward(self, descriptors: Float[Tensor, "b d"], pairing: Pairing) -> PlaceLossOutput:
        """Mean over the anchors of a relation or of triplets."""
        relation = as_relation(descriptors, pairing)
        usable = relation.usable()
        if not bool(usable.any()):
            return nothing(descriptors)
        wide = descriptors.to(torch.promote_types(descriptors.dtype, torch.float32))
        unit = F.normalize(wide, dim=1)
        scores = (unit @ unit.T / self.temperature)[usable]
        positive, negative = relation.positive[usable], relation.negative[usable]
        right = scores.masked_fill(~positive, -torch.inf)
        wrong = scores.masked_fill(~negative, -torch.inf)
        value = F.softplus(wrong.logsumexp(1) - right.logsumexp(1)).mean()
        return PlaceLossOutput(value, (wrong.amax(1) >= right.amax(1)).float().mean())
