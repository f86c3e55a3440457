r"""The ratio loss, for each triplet

.. math:: L = \max\left(0,\; 1 - \frac{d_-}{d_+ + m}\right) + w\, d_+^2 .

Apart from the pair term it lies in [0, 1], is active while :math:`d_- < d_+ + m`, and has the derivatives
:math:`\partial L/\partial d_- = -1/(d_+ + m)` and :math:`\partial L/\partial d_+ = d_-/(d_+ + m)^2`. As m goes to 0 it
depends on the ratio alone, so that descriptors need no normalisation; but near :math:`d_+ = 0` the gradient grows like
:math:`1/m`, hence :data:`SMALLEST_MARGIN`. The pair term, which the source has with w = 1, keeps the descriptors of one
place together; without it the loss does not bound their size.

Source: P. Wohlhart, V. Lepetit, "Learning descriptors for object recognition and 3D pose estimation", CVPR 2015, whose
loss M. Lopez-Antequera et al., "Appearance-invariant place recognition by discriminatively training a convolutional
neural network", Pattern Recognition Letters 92, 2017, use as far as we know.
"""

from jaxtyping import Bool, Float
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.losses.place_loss import TripletLoss

SMALLEST_MARGIN = 0.01


def triplet_ratio(
    positive: Float[Tensor, "*t"], negative: Float[Tensor, "*t"], margin: float = SMALLEST_MARGIN
) -> Float[Tensor, "*t"]:
    """``max(0, 1 - d- / (d+ + m))`` of each triplet; distances are at least 0."""
    return (1 - negative / (positive + margin)).clamp(min=0)


class TripletRatioLoss(TripletLoss):
    """The ratio loss; see the module. A triplet is active while ``d- < d+ + margin``.

    Args:
        margin: m, at least :data:`SMALLEST_MARGIN`.
        pair_weight: w of the squared distances of the positives, at least 0.

    Raises:
        UserError: the margin is too small or the weight negative.

    Example:
        >>> import torch
        >>> descriptors, triplet = torch.tensor([[0.0], [0.99], [0.25]]), torch.tensor([[0, 1, 2]])
        >>> TripletRatioLoss(margin=0.01)(descriptors, triplet).value  # 1 - 0.25 / (0.99 + 0.01)
        tensor(0.7500)
    """

    def __init__(self, *, margin: float = SMALLEST_MARGIN, pair_weight: float = 0.0):
        super().__init__()
        if not SMALLEST_MARGIN <= margin < float("inf"):
            raise ArgumentError(
                f"margin={margin} must be at least {SMALLEST_MARGIN}: the gradient grows like 1/margin",
                f"margin={SMALLEST_MARGIN}",
            )
        if not 0 <= pair_weight < float("inf"):
            raise ArgumentError(f"pair_weight={pair_weight} must be at least 0", "pair_weight=0")
        self.margin, self.pair_weight = margin, pair_weight

    def of_distances(
        self, positive: Float[Tensor, "t"], negative: Float[Tensor, "t"]
    ) -> tuple[Float[Tensor, "t"], Bool[Tensor, "t"]]:
        """Loss of each triplet, and whether it is active."""
        loss = triplet_ratio(positive, negative, self.margin)
        if self.pair_weight:
            loss = loss + self.pair_weight * positive.square()
        return loss, negative < positive + self.margin
