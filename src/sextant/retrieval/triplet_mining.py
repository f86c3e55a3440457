r"""Mining: the choice of triplets (anchor, positive, negative) of a batch or a training set for the loss.

All positives and negatives come from a :class:`~sextant.retrieval.Relation`, so that a pair it ignores is never used.
With :math:`d_+` and :math:`d_-` the distances from the anchor's descriptor to those of positive and negative:

* *random*: both are drawn uniformly;
* *semi-hard*: for every pair of anchor and positive, a negative is drawn among those further than the positive, but
  within a margin: :math:`d_+ < d_- < d_+ + m`. Pairs without one give no triplet;
* *batch-hard*: for every anchor, the furthest positive and the nearest negative of the batch;
* *cached-hard*: for every anchor, the nearest negatives among a sample of the whole training set, by descriptors that
  were computed some steps ago. The positive is the nearest or the furthest by those descriptors, or one at random.

Anchors without a positive or without a negative give no triplet and are counted.

Sources: F. Schroff et al., "FaceNet", CVPR 2015 (semi-hard); A. Hermans et al., "In defense of the triplet loss for
person re-identification", 2017 (batch-hard); R. Arandjelovic et al., "NetVLAD", CVPR 2016 (cached), with the sampled
candidates of G. Berton et al., "Deep visual geo-localization benchmark", CVPR 2022.
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import torch
from jaxtyping import Bool, Float, Int64, Shaped
from torch import Tensor

from sextant.ranges import Count, Positive, checked
from sextant.retrieval.relations import Relation


class Mined(NamedTuple):
    """Mined triplets, and how many anchors there were to mine from.

    Attributes:
        triplets: anchor, positive, negative.
        anchors: number of images that could have been anchors.
        unusable: number of anchors without a positive or without a negative.
    """

    triplets: Int64[Tensor, "t 3"]
    anchors: int
    unusable: int


class Mining(Protocol):
    """The interface of an experiment's ``mining``, for triplets within a batch."""

    def __call__(
        self, descriptors: Float[Tensor, "b d"], relation: Relation, generator: torch.Generator | None = None
    ) -> Mined:
        """Triplets of indices into the batch; ``generator`` is on the CPU."""
        ...


@dataclass(frozen=True)
class NoMining:
    """Keeps every triplet of the batch; losses of pairs then use the relation itself."""

    def __call__(
        self, descriptors: Float[Tensor, "b d"], relation: Relation, generator: torch.Generator | None = None
    ) -> Mined:
        """All triplets of the relation; nothing is drawn."""
        return _mined(relation, *all_triplets(relation).unbind(1))


@checked
@dataclass(frozen=True)
class RandomMining:
    """Draws positives and negatives uniformly.

    Args:
        per_anchor: number of triplets per anchor.

    Raises:
        UserError: ``per_anchor`` is below 1.
    """

    per_anchor: Count = 1

    def __call__(
        self, descriptors: Float[Tensor, "b d"], relation: Relation, generator: torch.Generator | None = None
    ) -> Mined:
        """Triplets of indices into the batch; the descriptors are not used."""
        anchor = relation.usable().nonzero()[:, 0].repeat_interleave(self.per_anchor)
        positive = draw_column(relation.positive[anchor], generator)
        negative = draw_column(relation.negative[anchor], generator)
        return _mined(relation, anchor, positive, negative)


@checked
@dataclass(frozen=True)
class SemiHardMining:
    """For every pair of anchor and positive, draws a negative with ``d+ < d- < d+ + margin``.

    Args:
        margin: in the unit of the descriptors; the largest distance of unit vectors is 2.

    Raises:
        UserError: ``margin`` is not positive.
    """

    margin: Positive = 0.1

    def __call__(
        self, descriptors: Float[Tensor, "b d"], relation: Relation, generator: torch.Generator | None = None
    ) -> Mined:
        """Triplets of indices into the batch, at most one per pair."""
        apart = descriptor_distances(descriptors)
        anchor, positive = relation.positive.nonzero().unbind(1)
        near = apart[anchor, positive][:, None]
        band = relation.negative[anchor] & (apart[anchor] > near) & (apart[anchor] < near + self.margin)
        found = band.any(1)
        return _mined(relation, anchor[found], positive[found], draw_column(band[found], generator))


@dataclass(frozen=True)
class BatchHardMining:
    """For every anchor, takes the furthest positive and the nearest negative."""

    def __call__(
        self, descriptors: Float[Tensor, "b d"], relation: Relation, generator: torch.Generator | None = None
    ) -> Mined:
        """Triplets of indices into the batch, one per anchor; nothing is drawn."""
        apart = descriptor_distances(descriptors)
        anchor = relation.usable().nonzero()[:, 0]
        if len(anchor) == 0:
            return _mined(relation, anchor, anchor, anchor)
        positive = apart.masked_fill(~relation.positive, -1.0)[anchor].argmax(1)
        negative = apart.masked_fill(~relation.negative, torch.inf)[anchor].argmin(1)
        return _mined(relation, anchor, positive, negative)


def draw_column(allowed: Bool[Tensor, "m n"], generator: torch.Generator | None = None) -> Int64[Tensor, "m"]:
    """Draw one allowed column of each row, uniformly; every row must allow at least one.

    Draws are made on the CPU whatever the device, so that one seed gives one result.
    """
    if allowed.numel() == 0:
        return torch.zeros(len(allowed), dtype=torch.int64, device=allowed.device)
    share = torch.rand(len(allowed), generator=generator, dtype=torch.float64).to(allowed.device)
    counts = allowed.sum(1)
    wanted = (share * counts).long().clamp(max=counts - 1)  # the rounding of share * counts may reach counts
    return (allowed.cumsum(1) > wanted[:, None]).long().argmax(1)


@torch.no_grad()
def descriptor_distances(descriptors: Float[Tensor, "b d"]) -> Float[Tensor, "b b"]:
    """Euclidean distances, by differences, in float32 or wider and without gradient.

    Raises:
        ValueError: a descriptor is not finite.
    """
    wide = descriptors.to(torch.promote_types(descriptors.dtype, torch.float32))
    if not bool(wide.isfinite().all()):
        raise ValueError("a descriptor is not finite")
    return torch.cdist(wide, wide, compute_mode="donot_use_mm_for_euclid_dist")


def gathered(triplets: Int64[Tensor, "t 3"]) -> tuple[Int64[Tensor, "u"], Int64[Tensor, "t 3"]]:
    """The images that triplets of a training set consist of, each once, and the triplets as indices into those.

    >>> gathered(torch.tensor([[7, 9, 2], [7, 9, 4]]))
    (tensor([2, 4, 7, 9]), tensor([[2, 3, 0],
            [2, 3, 1]]))
    """
    images, inverse = torch.unique(triplets, return_inverse=True)
    return images, inverse.reshape(triplets.shape)


def all_triplets(relation: Relation) -> Int64[Tensor, "t 3"]:
    """Every triplet of a square relation, in order of anchor, positive, negative.

    >>> positive = torch.tensor([[False, True, False], [True, False, False], [False, False, False]])
    >>> negative = torch.tensor([[False, False, True], [False, False, True], [True, True, False]])
    >>> all_triplets(Relation(positive, negative))
    tensor([[0, 1, 2],
            [1, 0, 2]])
    """
    anchor, positive = relation.positive.nonzero().unbind(1)
    pair, negative = relation.negative[anchor].nonzero().unbind(1)
    return torch.stack([anchor[pair], positive[pair], negative], 1)


def _mined(relation: Relation, *columns: Shaped[Tensor, "t"]) -> Mined:
    usable = int(relation.usable().sum())
    return Mined(torch.stack(columns, 1), len(relation.positive), len(relation.positive) - usable)
