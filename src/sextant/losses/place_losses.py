"""Losses that make place descriptors similar for images of one place and different for others."""

from abc import abstractmethod
from typing import Annotated, NamedTuple, TypeAlias

import torch
import torch.nn.functional as F
from annotated_types import Ge, Le
from jaxtyping import Bool, Float, Int64
from torch import Tensor, nn

from sextant.ranges import NonNegative, Positive, checked
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
    r"""A loss on the descriptors of a batch.

    A triplet is an anchor, a positive of its place and a negative of another. With f the descriptors,
    :math:`d_+ = \|f_a - f_p\|` and :math:`d_- = \|f_a - f_n\|`. Where two descriptors are equal the distance has no
    gradient, and its subgradient 0 is taken.
    """

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
    """Euclidean distances in float32 or wider, by differences, so that near descriptors suffer no cancellation."""
    wide = descriptors.to(torch.promote_types(descriptors.dtype, torch.float32))
    return torch.cdist(wide, wide, compute_mode="donot_use_mm_for_euclid_dist")


def cosine_similarities(descriptors: Float[Tensor, "b d"]) -> Float[Tensor, "b b"]:
    """Cosine similarities in float32 or wider, also under autocast, which would round the product."""
    wide = descriptors.to(torch.promote_types(descriptors.dtype, torch.float32))
    with torch.autocast(descriptors.device.type, enabled=False):
        unit = F.normalize(wide, dim=1)
        return unit @ unit.T


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
    """The loss of no triplets: 0, with gradient 0, so that the training step can proceed."""
    return PlaceLossOutput(0 * descriptors.float().sum(), torch.zeros((), device=descriptors.device))


class ContrastiveLoss(PlaceLoss):
    r"""The contrastive loss over pairs: it pulls positives together and pushes negatives at least a margin apart.

    ``active`` is the share of negative pairs nearer than the margin.

    .. math:: L = \tfrac12 \operatorname{mean}_{+} d^2 + \tfrac12 \operatorname{mean}_{-} \max(0, \alpha - d)^2

    Each mean is over its own kind of pairs, since a batch has many times more negatives; the mean of no pairs is 0.

    Source: R. Hadsell et al., "Dimensionality reduction by learning an invariant mapping", CVPR 2006.

    Args:
        margin: distance in the unit of the descriptors, above 0.

    Raises:
        UserError: the margin is not positive.

    Example:
        >>> descriptors, triplet = torch.tensor([[0.0], [0.4], [0.3]]), torch.tensor([[0, 1, 2]])
        >>> ContrastiveLoss(margin=0.5)(descriptors, triplet).value  # (0.4² + (0.5 - 0.3)²) / 2
        tensor(0.1000)
    """

    @checked
    def __init__(self, *, margin: Positive = 0.5):
        super().__init__()
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


class TripletMarginLoss(TripletLoss):
    r"""The triplet margin loss: :math:`L = \max(0,\; d_+ - d_- + \alpha)`, or the same with both distances squared.

    A triplet is active while its loss is above 0.

    With squares, gradients grow with the distance; without, they have equal norms.

    Sources: K. Weinberger, L. Saul, "Distance metric learning for large margin nearest neighbor classification", JMLR
    2009; F. Schroff et al., "FaceNet", CVPR 2015 (squares).

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

    @checked
    def __init__(self, *, margin: Positive = 0.1, squared: bool = False):
        super().__init__()
        self.margin, self.squared = margin, squared

    def of_distances(
        self, positive: Float[Tensor, "t"], negative: Float[Tensor, "t"]
    ) -> tuple[Float[Tensor, "t"], Bool[Tensor, "t"]]:
        """Loss of each triplet, and whether it is active."""
        if self.squared:
            positive, negative = positive.square(), negative.square()
        short = positive - negative + self.margin
        return short.clamp(min=0), short > 0


SMALLEST_MARGIN = 0.01


def triplet_ratio(
    positive: Float[Tensor, "*t"], negative: Float[Tensor, "*t"], margin: float = SMALLEST_MARGIN
) -> Float[Tensor, "*t"]:
    """``max(0, 1 - d- / (d+ + m))`` of each triplet; distances are at least 0."""
    return (1 - negative / (positive + margin)).clamp(min=0)


class TripletRatioLoss(TripletLoss):
    r"""The ratio loss, for each triplet

    .. math:: L = \max\left(0,\; 1 - \frac{d_-}{d_+ + m}\right) + w\, d_+^2 .

    Apart from the pair term it lies in [0, 1], is active while :math:`d_- < d_+ + m`, and has the derivatives
    :math:`\partial L/\partial d_- = -1/(d_+ + m)` and :math:`\partial L/\partial d_+ = d_-/(d_+ + m)^2`. As m goes to 0
    it depends on the ratio alone, so that descriptors need no normalisation; but near :math:`d_+ = 0` the gradient
    grows like :math:`1/m`, hence :data:`SMALLEST_MARGIN`. The pair term, which the source has with w = 1, keeps the
    descriptors of one place together; without it the loss does not bound their size.

    Source: P. Wohlhart, V. Lepetit, "Learning descriptors for object recognition and 3D pose estimation", CVPR 2015,
    whose loss M. Lopez-Antequera et al., "Appearance-invariant place recognition by discriminatively training a
    convolutional neural network", Pattern Recognition Letters 92, 2017, use as far as we know.

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

    @checked
    def __init__(
        self, *, margin: Annotated[float, Ge(SMALLEST_MARGIN)] = SMALLEST_MARGIN, pair_weight: NonNegative = 0.0
    ):
        super().__init__()
        self.margin, self.pair_weight = margin, pair_weight

    def of_distances(
        self, positive: Float[Tensor, "t"], negative: Float[Tensor, "t"]
    ) -> tuple[Float[Tensor, "t"], Bool[Tensor, "t"]]:
        """Loss of each triplet, and whether it is active."""
        loss = triplet_ratio(positive, negative, self.margin)
        if self.pair_weight:
            loss = loss + self.pair_weight * positive.square()
        return loss, negative < positive + self.margin


class SoftMarginLoss(TripletLoss):
    r"""The soft-margin loss: :math:`L = \log(1 + e^{s (d_+ - d_-)})`, whose gradient never quite vanishes.

    A triplet counts as active while ``d- <= d+``: its order is wrong.

    Source: A. Hermans et al., "In defense of the triplet loss for person re-identification", 2017, with s = 1.
    Distances of unit vectors are at most 2, where s = 1 leaves a loss of at least log(1 + e⁻²) = 0.13; a larger s takes
    it closer to 0.

    Args:
        scale: s, above 0.

    Raises:
        UserError: the scale is not positive.

    Example:
        >>> import torch
        >>> SoftMarginLoss()(torch.tensor([[0.0], [1.0], [1.0]]), torch.tensor([[0, 1, 2]])).value  # equally far: ln 2
        tensor(0.6931)
    """

    @checked
    def __init__(self, *, scale: Positive = 1.0):
        super().__init__()
        self.scale = scale

    def of_distances(
        self, positive: Float[Tensor, "t"], negative: Float[Tensor, "t"]
    ) -> tuple[Float[Tensor, "t"], Bool[Tensor, "t"]]:
        """Loss of each triplet, and whether it is active."""
        return F.softplus(self.scale * (positive - negative)), negative <= positive


class MultiSimilarityLoss(PlaceLoss):
    r"""The multi-similarity loss.

    ``active`` is the share of the pairs that the mining keeps.

    With the cosine similarity :math:`s_{ij}`, the loss of anchor i is

    .. math:: L_i = \frac1\alpha \log\Big(1 + \sum_{j \in +} e^{-\alpha (s_{ij} - \lambda)}\Big)
                  + \frac1\beta \log\Big(1 + \sum_{j \in -} e^{\beta (s_{ij} - \lambda)}\Big),

    averaged over all images of the batch, including those without a pair, whose loss is 0. Only informative pairs are
    kept: positives less similar than the most similar negative plus :math:`\epsilon`, negatives more similar than the
    least similar positive minus :math:`\epsilon`. Pairs are those of a relation, in which images may be ignored.

    Source: X. Wang et al., "Multi-similarity loss with general pair weighting for deep metric learning", CVPR 2019.

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

    @checked
    def __init__(
        self,
        *,
        alpha: Positive = 2.0,
        beta: Positive = 50.0,
        base: Annotated[float, Ge(-1), Le(1)] = 0.5,
        epsilon: NonNegative | None = 0.1,
    ):
        super().__init__()
        self.alpha, self.beta, self.base, self.epsilon = alpha, beta, base, epsilon

    def forward(self, descriptors: Float[Tensor, "b d"], pairing: Pairing) -> PlaceLossOutput:
        """Loss of the pairs of a relation, or of those in triplets."""
        relation = as_relation(descriptors, pairing)
        kept = relation if self.epsilon is None else informative_pairs(descriptors, relation, self.epsilon)
        before, after = (int(pairs.positive.sum() + pairs.negative.sum()) for pairs in (relation, kept))
        if after == 0:
            return nothing(descriptors)
        above = cosine_similarities(descriptors) - self.base
        value = _log_of_one_plus_sum(-self.alpha * above, kept.positive) / self.alpha
        value = value + _log_of_one_plus_sum(self.beta * above, kept.negative) / self.beta
        return PlaceLossOutput(value.mean(), torch.tensor(after / before, device=descriptors.device))


def _log_of_one_plus_sum(exponents: Float[Tensor, "b b"], chosen: Bool[Tensor, "b b"]) -> Float[Tensor, "b"]:
    """Log of 1 plus the exponentials of each row's chosen entries, without overflow."""
    return torch.logsumexp(F.pad(exponents.masked_fill(~chosen, -torch.inf), (1, 0)), dim=1)


@torch.no_grad()
def informative_pairs(descriptors: Float[Tensor, "b d"], relation: Relation, epsilon: float) -> Relation:
    """The pairs that the multi-similarity loss learns from; anchors without positives or negatives have none."""
    similarity = cosine_similarities(descriptors)
    best_wrong = similarity.masked_fill(~relation.negative, -torch.inf).amax(1, keepdim=True)
    worst_right = similarity.masked_fill(~relation.positive, torch.inf).amin(1, keepdim=True)
    return Relation(
        relation.positive & (similarity < best_wrong + epsilon),
        relation.negative & (similarity > worst_right - epsilon),
    )


class InfoNCELoss(PlaceLoss):
    r"""InfoNCE: the negative log-probability that an image drawn by similarity to an anchor shows its place.

    With the cosine similarity :math:`s_{ij}` and temperature T, for every anchor i with a positive and a negative

    .. math:: L_i = -\log \frac{\sum_{j \in +} e^{s_{ij}/T}}{\sum_{j \in + \cup -} e^{s_{ij}/T}} .

    Ignored pairs are in neither sum. Evaluated on a whole traverse this is the negative log-likelihood of the place.

    Sources: A. van den Oord et al., "Representation learning with contrastive predictive coding", 2018; the sum over
    several positives within the logarithm is from A. Miech et al., "End-to-end learning of visual representations from
    uncurated instructional videos", CVPR 2020.

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

    @checked
    def __init__(self, *, temperature: Positive = 0.07):
        super().__init__()
        self.temperature = temperature

    def forward(self, descriptors: Float[Tensor, "b d"], pairing: Pairing) -> PlaceLossOutput:
        """Mean over the anchors of a relation or of triplets."""
        relation = as_relation(descriptors, pairing)
        usable = relation.usable()
        if not bool(usable.any()):
            return nothing(descriptors)
        scores = (cosine_similarities(descriptors) / self.temperature)[usable]
        positive, negative = relation.positive[usable], relation.negative[usable]
        right = scores.masked_fill(~positive, -torch.inf)
        wrong = scores.masked_fill(~negative, -torch.inf)
        value = F.softplus(wrong.logsumexp(1) - right.logsumexp(1)).mean()
        return PlaceLossOutput(value, (wrong.amax(1) >= right.amax(1)).float().mean())
