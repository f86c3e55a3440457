r"""What losses of place descriptors share: they map pairs or triplets to one number and the share that is active.

A triplet is an anchor, a positive of its place and a negative of another. With f the descriptors,
:math:`d_+ = \|f_a - f_p\|` and :math:`d_- = \|f_a - f_n\|`. Where two descriptors are equal the distance has no
gradient, and its subgradient 0 is taken.
"""

from abc import abstractmethod
from typing import NamedTuple, TypeAlias

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor, nn

from sextant.retrieval import Relation, all_triplets

#: which images are to be compared: all pairs of a relation, or triplets of indices
Pairing: TypeAlias = Relation | Int64[Tensor, "t 3"]


class PlaceLossOutput(NamedTuple):
    """A loss, and the share of its triplets or pairs that still contribute.

    Attributes:
        value: the loss, to be minimised; 0, with a gradient of 0, where there was nothing to compare.
        active: share of triplets or pairs that do not yet satisfy the loss; each loss says which. 0 if there are none.
    """

    value: Float[Tensor, ""]
    active: Float[Tensor, ""]


class PlaceLoss(nn.Module):
    """A loss on the descriptors of a batch."""

    @abstractmethod
    def forward(self, descriptors: Float[Tensor, "b d"], pairing: Pairing) -> PlaceLossOutput:
        """Loss of descriptors, and the share that is active.

        Args:
            descriptors: one per row; half precision is computed in single.
            pairing: a square relation of the batch, of which every pair or triplet counts, or mined triplets.

        Raises:
            ValueError: the pairing is not of this batch.
        """


class TripletLoss(PlaceLoss):
    """The mean of a function of ``(d+, d-)`` over triplets."""

    @abstractmethod
    def of_distances(
        self, positive: Float[Tensor, "t"], negative: Float[Tensor, "t"]
    ) -> tuple[Float[Tensor, "t"], Bool[Tensor, "t"]]:
        """Loss of each triplet, and whether it is active."""

    def forward(self, descriptors: Float[Tensor, "b d"], pairing: Pairing) -> PlaceLossOutput:
        """Mean loss over the triplets, or over all triplets of a relation."""
        check_pairing(descriptors, pairing)
        triplets = all_triplets(pairing) if isinstance(pairing, Relation) else pairing
        if len(triplets) == 0:
            return nothing(descriptors)
        anchor, near, far = triplets.unbind(1)
        apart = pairwise_distances(descriptors)
        loss, active = self.of_distances(apart[anchor, near], apart[anchor, far])
        return PlaceLossOutput(loss.mean(), active.float().mean())


def pairwise_distances(descriptors: Float[Tensor, "b d"]) -> Float[Tensor, "b b"]:
    """Euclidean distances in float32 or wider, by differences, so that near descriptors lose no digits."""
    wide = descriptors.to(torch.promote_types(descriptors.dtype, torch.float32))
    return torch.cdist(wide, wide, compute_mode="donot_use_mm_for_euclid_dist")


def as_relation(descriptors: Float[Tensor, "b d"], pairing: Pairing) -> Relation:
    """The pairs of a pairing; triplets give each anchor with its positive and with its negative, once.

    Raises:
        ValueError: the pairing is not of this batch, or a pair is positive in one triplet and negative in another.
    """
    check_pairing(descriptors, pairing)
    if isinstance(pairing, Relation):
        return pairing
    masks = torch.zeros(2, len(descriptors), len(descriptors), dtype=torch.bool, device=descriptors.device)
    anchor, near, far = pairing.unbind(1)
    masks[0, anchor, near] = True
    masks[1, anchor, far] = True
    return Relation(masks[0], masks[1])


def check_pairing(descriptors: Float[Tensor, "b d"], pairing: Pairing) -> None:
    """Refuse a pairing of another batch.

    Raises:
        ValueError: a relation is not ``(b, b)``, or an index of a triplet is not in [0, b).
    """
    count = len(descriptors)
    if isinstance(pairing, Relation):
        if pairing.positive.shape != (count, count):
            raise ValueError(f"a relation of {tuple(pairing.positive.shape)} images for {count} descriptors")
    elif pairing.numel() and not (int(pairing.min()) >= 0 and int(pairing.max()) < count):
        raise ValueError(f"triplets of images {int(pairing.min())} to {int(pairing.max())} for {count} descriptors")


def nothing(descriptors: Float[Tensor, "b d"]) -> PlaceLossOutput:
    """The loss of no triplets: 0, with gradient 0, so that a training step goes through."""
    return PlaceLossOutput(0 * descriptors.float().sum(), torch.zeros((), device=descriptors.device))
