r"""The soft-margin loss: :math:`L = \log(1 + e^{s (d_+ - d_-)})`, whose gradient never quite vanishes.

Source: A. Hermans et al., "In defense of the triplet loss for person re-identification", 2017, with s = 1. Distances of
unit vectors are at most 2, where s = 1 leaves a loss of at least log(1 + e⁻²) = 0.13; a larger s takes it closer to 0.
"""

import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.losses.place_loss import TripletLoss


class SoftMarginLoss(TripletLoss):
    """The soft-margin loss; see the module. A triplet counts as active while ``d- <= d+``: its order is wrong.

    Args:
        scale: s, above 0.

    Raises:
        UserError: the scale is not positive.

    Example:
        >>> import torch
        >>> SoftMarginLoss()(torch.tensor([[0.0], [1.0], [1.0]]), torch.tensor([[0, 1, 2]])).value  # equally far: ln 2
        tensor(0.6931)
    """

    def __init__(self, *, scale: float = 1.0):
        super().__init__()
        if not 0 < scale < float("inf"):
            raise ArgumentError(f"scale={scale} must be above 0", "For example scale=1.0")
        self.scale = scale

    def of_distances(
        self, positive: Float[Tensor, "t"], negative: Float[Tensor, "t"]
    ) -> tuple[Float[Tensor, "t"], Bool[Tensor, "t"]]:
        """Loss of each triplet, and whether it is active."""
        return F.softplus(self.scale * (positive - negative)), negative <= positive
