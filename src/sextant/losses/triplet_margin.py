r"""The triplet margin loss: :math:`L = \max(0,\; d_+ - d_- + \alpha)`, or the same with both distances squared.

Squares pull hardest on what is furthest apart, distances on all alike.

Sources: K. Weinberger, L. Saul, "Distance metric learning for large margin nearest neighbor classification", JMLR 2009;
F. Schroff et al., "FaceNet", CVPR 2015 (squares).
"""

from jaxtyping import Bool, Float
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.losses.place_loss import TripletLoss


class TripletMarginLoss(TripletLoss):
    """The margin loss; see the module. A triplet is active while its loss is above 0.

    Args:
        margin: in the unit of the descriptors, or of their squares; above 0. Distances of unit vectors are at most 2.
        squared: compare squared distances.

    Raises:
        UserError: the margin is not positive.

    Example:
        >>> import torch
        >>> descriptors, triplet = torch.tensor([[0.0], [1.0], [1.2]]), torch.tensor([[0, 1, 2]])
        >>> TripletMarginLoss(margin=0.5)(descriptors, triplet).value  # 1 - 1.2 + 0.5
        tensor(0.3000)
    """

    def __init__(self, *, margin: float = 0.1, squared: bool = False):
        super().__init__()
        if not 0 < margin < float("inf"):
            raise ArgumentError(f"margin={margin} must be above 0", "For example margin=0.1")
        self.margin, self.squared = margin, squared

    def of_distances(
        self, positive: Float[Tensor, "t"], negative: Float[Tensor, "t"]
    ) -> tuple[Float[Tensor, "t"], Bool[Tensor, "t"]]:
        """Loss of each triplet, and whether it is active."""
        if self.squared:
            positive, negative = positive.square(), negative.square()
        short = positive - negative + self.margin
        return short.clamp(min=0), short > 0
