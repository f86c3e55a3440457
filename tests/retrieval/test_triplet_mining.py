"""Mining against brute force: never a false positive or negative, and the triplets that each sort promises."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from sextant.chapters.places.data import PlaceTolerance
from sextant.retrieval import (
    BatchHardMining,
    CachedHardMining,
    Places,
    RandomMining,
    Relation,
    SemiHardMining,
    all_triplets,
    gathered,
    relations,
)
from sextant.retrieval.triplet_mining import draw_column

MININGS = [RandomMining(), RandomMining(3), SemiHardMining(0.2), SemiHardMining(5.0), BatchHardMining()]


def seeded(seed):
    return torch.Generator().manual_seed(seed)


@st.composite
def batches(draw):
    """Descriptors, and any relation whatever."""
    b, seed = draw(st.integers(0, 10)), draw(st.integers(0, 2**31))
    generator = seeded(seed)
    kind = (
        torch.multinomial(torch.tensor([0.3, 0.5, 0.2]), b * b, True, generator=generator).reshape(b, b) if b else None
    )
    kind = torch.zeros(0, 0) if kind is None else kind
    coarse = draw(st.booleans())  # with ties
    x = torch.randn(b, 3, generator=generator)
    off = ~torch.eye(b, dtype=torch.bool)
    return (x.round() if coarse else x), Relation((kind == 0) & off, (kind == 1) & off), generator


def rows(triplets):
    return [tuple(triplet) for triplet in triplets.tolist()]


@pytest.mark.parametrize("mining", MININGS, ids=str)
@given(batch=batches())
def test_never_a_false_positive_or_negative_and_every_unusable_anchor_counted(mining, batch):
    x, relation, generator = batch
    triplets, anchors, unusable = mining(x, relation, generator)
    usable = {i for i in range(len(x)) if relation.positive[i].any() and relation.negative[i].any()}
    assert (anchors, unusable) == (len(x), len(x) - len(usable))
    for a, p, n in rows(triplets):
        assert relation.positive[a, p]
        assert relation.negative[a, n]
    found = {a for a, _, _ in rows(triplets)}
    assert found <= usable
    if not isinstance(mining, SemiHardMining):
        assert found == usable


@given(batch=batches())
def test_batch_hard_takes_the_furthest_positive_and_the_nearest_negative(batch):
    x, relation, _ = batch
    for a, p, n in rows(BatchHardMining()(x, relation).triplets):
        apart = [float((x[a] - other).norm()) for other in x]
        assert apart[p] == pytest.approx(max(apart[j] for j in range(len(x)) if relation.positive[a, j]), abs=1e-6)
        assert apart[n] == pytest.approx(min(apart[j] for j in range(len(x)) if relation.negative[a, j]), abs=1e-6)


@pytest.mark.parametrize("margin", [0.3, 2.0])
@given(batch=batches())
def test_semi_hard_finds_a_negative_in_the_band_for_every_pair_that_has_one(margin, batch):
    x, relation, generator = batch
    apart = torch.cdist(x, x, compute_mode="donot_use_mm_for_euclid_dist")
    found = rows(SemiHardMining(margin)(x, relation, generator).triplets)
    for a, p, n in found:
        assert apart[a, p] < apart[a, n] < apart[a, p] + margin
    expected = {(a, p) for a, p, n in rows(all_triplets(relation)) if apart[a, p] < apart[a, n] < apart[a, p] + margin}
    assert len(found) == len(expected)
    assert {(a, p) for a, p, _ in found} == expected


@given(batch=batches())
def test_all_triplets_are_all_of_them(batch):
    _, relation, _ = batch
    b = len(relation.positive)
    expected = [
        (a, p, n)
        for a in range(b)
        for p in range(b)
        for n in range(b)
        if relation.positive[a, p] and relation.negative[a, n]
    ]
    assert rows(all_triplets(relation)) == expected


def test_columns_are_drawn_uniformly_among_the_allowed():
    allowed = torch.tensor([True, False, True, False, True]).expand(30_000, 5)
    counts = torch.bincount(draw_column(allowed, seeded(0)), minlength=5)
    assert counts[[1, 3]].sum() == 0
    expected = 10_000
    chi_square = ((counts[[0, 2, 4]] - expected) ** 2 / expected).sum()
    assert chi_square < 13.8  # 0.1 % of chi-square with two degrees of freedom


@pytest.mark.parametrize("mining", MININGS[:3], ids=str)
def test_a_seed_gives_one_result(mining):
    place = torch.arange(12) // 3
    same = place[:, None] == place
    relation = Relation(same & ~torch.eye(12, dtype=torch.bool), ~same)
    x = torch.randn(12, 3, generator=seeded(1))
    first, again, other = (mining(x, relation, seeded(seed)).triplets for seed in (5, 5, 6))
    assert torch.equal(first, again)
    assert first.shape != other.shape or not torch.equal(first, other)
    state = torch.random.get_rng_state()
    mining(x, relation, seeded(5))
    assert torch.equal(state, torch.random.get_rng_state())


def ride(seed, n=40):
    """Two conditions of one ride of n / 2 frames, one of them with stops, and descriptors."""
    frame = torch.arange(n) % (n // 2)
    frame[n // 2 :] = frame[n // 2 :] // 3 * 3
    return torch.randn(n, 3, generator=seeded(seed)), Places(frame[:, None])


@settings(max_examples=15)
@given(
    seed=st.integers(0, 1000),
    positive=st.sampled_from(["nearest", "random", "furthest"]),
    candidates=st.integers(1, 60),
    tolerance=st.sampled_from(
        [PlaceTolerance("frames", 1, 4), PlaceTolerance("frames", 0, 15), PlaceTolerance("frames", 50, 60)]
    ),
)
def test_cached_hard_takes_true_pairs_and_the_nearest_of_the_candidates(seed, positive, candidates, tolerance):
    cache, places = ride(seed)
    mining = CachedHardMining(anchors=25, candidates=candidates, negatives=3, positive=positive)
    triplets, anchors, unusable = mining(cache, places, tolerance, seeded(seed))
    whole = relations(places, tolerance)
    # what the mining has drawn, from the same generator
    generator = seeded(seed)
    drawn = torch.randperm(40, generator=generator)[:25].tolist()
    looked_at = torch.randperm(40, generator=generator)[:candidates].tolist()
    assert anchors == 25
    by_anchor = {}
    for a, p, n in rows(triplets):
        assert whole.positive[a, p]
        assert whole.negative[a, n]
        assert n in looked_at
        by_anchor.setdefault(a, []).append((p, n))
    usable = [a for a in drawn if whole.positive[a].any() and whole.negative[a][looked_at].any()]
    assert set(by_anchor) == set(usable)
    assert unusable == 25 - len(usable)
    for a, pairs in by_anchor.items():
        assert len({p for p, _ in pairs}) == 1
        apart = (cache - cache[a]).norm(dim=1)
        wrong = sorted(float(apart[n]) for n in looked_at if whole.negative[a, n])
        assert [float(apart[n]) for _, n in pairs] == pytest.approx(wrong[:3], abs=1e-5)
        right = apart[whole.positive[a]]
        if positive != "random":
            best = right.min() if positive == "nearest" else right.max()
            assert float(apart[pairs[0][0]]) == pytest.approx(float(best), abs=1e-5)


def test_the_blocks_of_cached_mining_do_not_show(monkeypatch):
    cache, places = ride(3)
    mining = CachedHardMining(anchors=30, candidates=20, negatives=4)
    whole = mining(cache, places, PlaceTolerance("frames", 1.0, 4.0), seeded(0)).triplets
    monkeypatch.setattr("sextant.retrieval.cached_mining.BLOCK", 80)
    assert torch.equal(mining(cache, places, PlaceTolerance("frames", 1.0, 4.0), seeded(0)).triplets, whole)


def test_gathered_triplets_mean_the_same_images():
    triplets = torch.tensor([[7, 3, 20], [3, 7, 9], [7, 3, 9]])
    images, local = gathered(triplets)
    assert images.tolist() == [3, 7, 9, 20]
    assert torch.equal(images[local], triplets)
    empty, none = gathered(torch.zeros(0, 3, dtype=torch.int64))
    assert len(empty) == 0
    assert none.shape == (0, 3)


def test_descriptors_that_are_not_finite_are_refused():
    broken = torch.full((4, 2), torch.nan)
    same = torch.eye(2, dtype=torch.bool).repeat_interleave(2, 0).repeat_interleave(2, 1)
    relation = Relation(same & ~torch.eye(4, dtype=torch.bool), ~same)
    for mining in (BatchHardMining(), SemiHardMining()):
        with pytest.raises(ValueError, match="not finite"):
            mining(broken, relation)
    with pytest.raises(ValueError, match="not finite"):
        CachedHardMining()(broken, Places(torch.arange(4)[:, None]), PlaceTolerance("frames", 1.0, 2.0))
    with pytest.raises(ValueError, match="4 cached"):
        CachedHardMining()(broken, Places(torch.arange(5)[:, None]), PlaceTolerance("frames", 1.0, 2.0))
