"""Losses of place descriptors: gradients by finite differences, limits, and values by hand."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.losses import (
    ContrastiveLoss,
    InfoNCELoss,
    MultiSimilarityLoss,
    SoftMarginLoss,
    TripletMarginLoss,
    TripletRatioLoss,
)
from sextant.losses.place_losses import triplet_ratio
from sextant.retrieval import Relation, all_triplets

LOSSES = {
    "ratio": TripletRatioLoss(),
    "ratio with pairs": TripletRatioLoss(pair_weight=0.3),
    "margin": TripletMarginLoss(margin=0.8),
    "squared margin": TripletMarginLoss(margin=0.8, squared=True),
    "soft": SoftMarginLoss(scale=2.0),
    "contrastive": ContrastiveLoss(margin=1.5),
    "info_nce": InfoNCELoss(temperature=0.5),
    "multi_similarity": MultiSimilarityLoss(epsilon=None),
}
TRIPLET_LOSSES = ("ratio", "ratio with pairs", "margin", "squared margin", "soft")


@pytest.fixture(params=LOSSES)
def loss(request):
    return LOSSES[request.param]


def three_places():
    """Six images of three places, and a seventh that is ignored by all."""
    place = torch.tensor([0, 0, 1, 1, 2, 2])
    same = place[:, None] == place
    positive, negative = torch.zeros(2, 7, 7, dtype=torch.bool)
    positive[:6, :6] = same & ~torch.eye(6, dtype=torch.bool)
    negative[:6, :6] = ~same
    return Relation(positive, negative)


def descriptors(seed=0, dtype=torch.float64):
    return torch.randn(7, 4, generator=torch.Generator().manual_seed(seed), dtype=dtype)


@pytest.mark.parametrize("seed", range(3))
def test_gradients_are_those_of_finite_differences(loss, seed):
    x = descriptors(seed).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: loss(x, three_places()).value, x)


def test_triplets_and_all_pairs_of_a_relation_say_the_same(loss):
    relation = three_places()
    whole, mined = loss(descriptors(), relation), loss(descriptors(), all_triplets(relation))
    torch.testing.assert_close(whole.value, mined.value)
    torch.testing.assert_close(whole.active, mined.active)


def test_an_image_that_is_ignored_changes_nothing_and_gets_no_gradient(loss):
    x = descriptors().requires_grad_()
    value = loss(x, three_places()).value
    value.backward()
    assert not x.grad[6].any()
    assert x.grad[:6].any()
    moved = x.detach().clone()
    moved[6] += 5
    torch.testing.assert_close(loss(moved, three_places()).value, value.detach())


def test_equal_descriptors_have_a_finite_loss_and_gradient(loss):
    x = torch.ones(7, 4).requires_grad_()
    said = loss(x, three_places())
    said.value.backward()
    assert said.value.isfinite()
    assert x.grad.isfinite().all()


def test_zero_descriptors_have_a_finite_loss_and_gradient(loss):
    x = torch.zeros(7, 4).requires_grad_()
    loss(x, three_places()).value.backward()
    assert x.grad.isfinite().all()


def test_without_pairs_the_loss_is_0_and_a_step_goes_through(loss):
    none = torch.zeros(7, 7, dtype=torch.bool)
    for pairing in (Relation(none, none), torch.zeros(0, 3, dtype=torch.int64)):
        x = descriptors(dtype=torch.float32).requires_grad_()
        said = loss(x, pairing)
        said.value.backward()
        assert said.value == said.active == 0
        assert not x.grad.any()


def test_half_precision_is_computed_in_single(loss):
    x = descriptors(dtype=torch.float32).bfloat16()
    said = loss(x, three_places())
    assert said.value.dtype == torch.float32
    torch.testing.assert_close(said.value, loss(x.float(), three_places()).value)


def test_mixed_precision_rounds_nothing(loss):
    x = descriptors(dtype=torch.float32)
    plain = loss(x, three_places())
    with torch.autocast("cpu", torch.bfloat16):
        mixed = loss(x, three_places())
    assert torch.equal(mixed.value, plain.value)
    assert torch.equal(mixed.active, plain.active)


def test_descent_separates_the_places(loss):
    x = descriptors(3, torch.float32).requires_grad_()
    before = loss(x, three_places())
    optimizer = torch.optim.Adam([x], 0.05)
    for _ in range(300):
        optimizer.zero_grad()
        loss(x, three_places()).value.backward()
        optimizer.step()
    after = loss(x, three_places())
    assert after.value < before.value
    unit = torch.nn.functional.normalize(x.detach()[:6], dim=1)
    cosine = (unit @ unit.T).fill_diagonal_(-2)
    nearest = (
        cosine
        if not isinstance(loss, tuple(type(LOSSES[n]) for n in TRIPLET_LOSSES))
        else -torch.cdist(x.detach()[:6], x.detach()[:6]).fill_diagonal_(1e9)
    ).argmax(1)
    assert nearest.tolist() == [1, 0, 3, 2, 5, 4]


def test_the_share_that_is_active_is_between_0_and_1(loss):
    for seed in range(5):
        assert 0 <= loss(descriptors(seed), three_places()).active <= 1


@pytest.mark.parametrize("triplet", [[[0, 1, 7]], [[-1, 1, 2]]])
def test_triplets_of_another_batch_are_refused(loss, triplet):
    with pytest.raises(ValueError, match="7 descriptors"):
        loss(descriptors(), torch.tensor(triplet))


def test_a_relation_of_another_batch_is_refused(loss):
    none = torch.zeros(5, 5, dtype=torch.bool)
    with pytest.raises(ValueError, match="7 descriptors"):
        loss(descriptors(), Relation(none, none))


distances = st.floats(0, 100)


@given(distances, distances)
def test_the_ratio_loss_is_within_0_and_1_and_active_iff_the_negative_is_within_the_margin(near, far):
    loss, active = TripletRatioLoss(margin=0.5).of_distances(*torch.tensor([near, far], dtype=torch.float64)[:, None])
    assert 0 <= loss <= 1
    assert (loss == 1) == (far == 0) or loss > 1 - 1e-12
    assert bool(active) == (far < near + 0.5)
    assert bool(loss > 0) == bool(active) or loss < 1e-12


@given(st.floats(0.1, 10), st.floats(0.1, 10), st.floats(1e-3, 1e3))
def test_with_no_margin_the_ratio_loss_knows_no_scale(near, far, scale):
    near, far = torch.tensor([near, far], dtype=torch.float64)
    torch.testing.assert_close(triplet_ratio(scale * near, scale * far, 1e-12), triplet_ratio(near, far, 1e-12))


@given(st.floats(0.1, 10), st.floats(0.0, 1.0))
def test_derivatives_of_the_ratio_loss(near, share):
    near = torch.tensor(near, dtype=torch.float64, requires_grad=True)
    far = (near.detach() * share).requires_grad_()
    triplet_ratio(near, far, 0.01).backward()
    torch.testing.assert_close(far.grad, -1 / (near.detach() + 0.01))
    torch.testing.assert_close(near.grad, far.detach() / (near.detach() + 0.01) ** 2)


TRIANGLE = torch.tensor([[0.0, 0.0], [3.0, 4.0], [0.0, 2.0]], dtype=torch.float64)  # d+ = 5, d- = 2
ONE = torch.tensor([[0, 1, 2]])


@pytest.mark.parametrize(
    ("loss", "value"),
    [
        (TripletRatioLoss(margin=1.0), 1 - 2 / 6),
        (TripletRatioLoss(margin=1.0, pair_weight=0.1), 1 - 2 / 6 + 2.5),
        (TripletMarginLoss(margin=0.5), 3.5),
        (TripletMarginLoss(margin=0.5, squared=True), 25 - 4 + 0.5),
        (SoftMarginLoss(), math.log(1 + math.exp(3))),
        (ContrastiveLoss(margin=3.0), (25 + 1) / 2),
        (ContrastiveLoss(margin=2.0), 25 / 2),
    ],
)
def test_values_by_hand(loss, value):
    assert loss(TRIANGLE, ONE).value.item() == pytest.approx(value)


def test_infonce_by_hand():
    x = torch.tensor([[1.0, 0.0], [0.0, 3.0], [2.0, 0.0], [-1.0, 0.0]], dtype=torch.float64)  # cosines 0, 1, -1
    said = InfoNCELoss(temperature=0.5)(x, torch.tensor([[0, 1, 2], [0, 1, 3]]))
    assert said.value.item() == pytest.approx(-math.log(1 / (1 + math.exp(2) + math.exp(-2))))
    assert said.active == 1


@pytest.mark.parametrize("epsilon", [None, 0.1])
def test_multi_similarity_is_its_equation(epsilon):
    alpha, beta, base = 2.0, 10.0, 0.4
    relation, x = three_places(), descriptors(2)
    unit = x / x.norm(dim=1, keepdim=True)
    similarity = (unit @ unit.T).tolist()
    total = kept = 0
    for i in range(7):
        right = [similarity[i][j] for j in range(7) if relation.positive[i, j]]
        wrong = [similarity[i][j] for j in range(7) if relation.negative[i, j]]
        if epsilon is not None and right and wrong:
            hardest, furthest = max(wrong), min(right)
            right = [s for s in right if s < hardest + epsilon]
            wrong = [s for s in wrong if s > furthest - epsilon]
        kept += len(right) + len(wrong)
        total += math.log(1 + sum(math.exp(-alpha * (s - base)) for s in right)) / alpha
        total += math.log(1 + sum(math.exp(beta * (s - base)) for s in wrong)) / beta
    said = MultiSimilarityLoss(alpha=alpha, beta=beta, base=base, epsilon=epsilon)(x, relation)
    assert said.value.item() == pytest.approx(total / 7)
    assert said.active.item() == pytest.approx(kept / (6 + 24))
