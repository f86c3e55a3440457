"""What holds of descriptors that learn from pairs, and what each of them optimises."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh
from sklearn.cross_decomposition import CCA as IterativeCCA
from sklearn.exceptions import NotFittedError

from benchmarks.traverse_statistics import recall_within_frames
from sextant.baselines import CCA, LDA, Hog, Pixels

SIZE = {"height": 8, "width": 16}


def pairs(count=160, seed=0, nuisance=3.0):
    """Places in two conditions: what they share is weak, and each condition has strong patterns of its own."""
    patterns = np.random.default_rng(99).normal(size=(24, 8, 16))
    rng = np.random.default_rng(seed)

    def images(shared, own, offset):
        coarse = np.einsum("nk,khw->nhw", shared, patterns[:12])
        coarse = coarse + nuisance * np.einsum("nk,khw->nhw", rng.normal(size=(count, 4)), patterns[own])
        values = 128 + 4 * (coarse + offset * patterns[20]) + rng.normal(size=coarse.shape)
        return np.clip(np.rint(values), 0, 255).astype(np.uint8)[..., None]

    shared = rng.normal(size=(count, 12))
    return images(shared, slice(12, 16), 2), images(shared, slice(16, 20), -2)


@pytest.fixture(scope="module", params=[LDA, CCA])
def fitted(request):
    """Fitted to one set of pairs; another is held out."""
    return request.param(**SIZE, dimensions=12, components=40).fit_pairs(*pairs())


def test_places_that_it_was_not_taught_are_found_better_than_by_pixels(fitted):
    reference, query = pairs(seed=1)
    pixels = Pixels(**SIZE)
    plain = recall_within_frames(pixels.describe(reference), pixels.describe(query), 0)
    learnt = recall_within_frames(fitted.describe(reference), fitted.describe_query(query), 0)
    assert learnt > plain + 0.2
    assert learnt > 0.8


def test_pairs_in_the_wrong_order_teach_nothing():
    reference, query = pairs()
    shuffled = query[np.random.default_rng(3).permutation(len(query))]
    held_out = pairs(seed=1)
    for kind in (LDA, CCA):
        descriptor = kind(**SIZE, dimensions=12, components=40).fit_pairs(reference, shuffled)
        found = recall_within_frames(descriptor.describe(held_out[0]), descriptor.describe_query(held_out[1]), 0)
        right = kind(**SIZE, dimensions=12, components=40).fit_pairs(reference, query)
        taught = recall_within_frames(right.describe(held_out[0]), right.describe_query(held_out[1]), 0)
        assert found < taught - 0.3


def test_rows_are_of_norm_one_and_flat_images_finite(fitted):
    reference, query = pairs(seed=1)
    for described in (fitted.describe(reference), fitted.describe_query(query)):
        assert described.shape == (160, 12)
        assert described.dtype == np.float32
        np.testing.assert_allclose(np.linalg.norm(described, axis=1), 1, atol=1e-5)
    assert np.isfinite(fitted.describe_query(np.full((2, 8, 16, 3), 9, np.uint8))).all()


def test_each_condition_has_its_own_mean(fitted):
    reference, _ = pairs(seed=1)
    assert not np.allclose(fitted.describe(reference), fitted.describe_query(reference), atol=0.05)


def test_chunks_change_nothing(fitted, monkeypatch):
    _, query = pairs(seed=1)
    whole = fitted.describe_query(query)
    monkeypatch.setattr("sextant.baselines.learned_projections.CHUNK", 7)
    np.testing.assert_allclose(fitted.describe_query(query), whole, atol=1e-5)


@given(seed=st.integers(0, 99), shrinkage=st.floats(0.01, 2))
def test_lda_maximises_the_ratio_of_scatters(seed, shrinkage):
    """Its directions beat any other set by the trace of the generalised Rayleigh quotient."""
    rng = np.random.default_rng(seed)
    shared = rng.normal(size=(50, 6)) * np.arange(1, 7)
    first, second = (shared + rng.normal(size=(50, 6)) for _ in range(2))
    first, second = first - first.mean(0), second - second.mean(0)
    found, _ = LDA(dimensions=2, components=6, shrinkage=shrinkage).learn_maps(first, second)
    places = (first + second) / 2
    within = sum(np.cov((each - places).T, bias=True) for each in (first, second)) / 2
    within = within + shrinkage * np.trace(within) / 6 * np.eye(6)
    between = np.cov(places.T, bias=True)

    def quotient(v):
        return np.trace(np.linalg.solve(v.T @ within @ v, v.T @ between @ v))

    assert quotient(found) == pytest.approx(eigh(between, within)[0][-2:].sum())
    assert all(quotient(rng.normal(size=(6, 2))) <= quotient(found) + 1e-9 for _ in range(20))


def test_cca_without_regularisation_has_scikit_learns_correlations():
    rng = np.random.default_rng(0)
    shared = rng.normal(size=(400, 3))
    first = np.column_stack([shared + 0.5 * rng.normal(size=(400, 3)), rng.normal(size=(400, 3))])
    second = np.column_stack([shared + rng.normal(size=(400, 3)), rng.normal(size=(400, 3))]) @ rng.normal(size=(6, 6))
    first, second = first - first.mean(0), second - second.mean(0)
    descriptor = CCA(dimensions=3, components=6, shrinkage=1e-9, weighting=0)
    maps = descriptor.learn_maps(first, second)
    ours = [np.corrcoef(*(x @ m[:, i] for x, m in zip((first, second), maps, strict=True)))[0, 1] for i in range(3)]
    theirs = IterativeCCA(3, max_iter=5000, tol=1e-10).fit(first, second).transform(first, second)
    expected = [np.corrcoef(theirs[0][:, i], theirs[1][:, i])[0, 1] for i in range(3)]
    np.testing.assert_allclose(ours, expected, atol=1e-3)
    np.testing.assert_allclose(ours, descriptor.correlations_, atol=1e-6)
    variates = first @ maps[0]
    np.testing.assert_allclose(variates.T @ variates / 400, np.eye(3), atol=1e-6)


def test_cca_weights_its_directions_by_their_correlation():
    rng = np.random.default_rng(0)
    first = rng.normal(size=(300, 5))
    second = first * np.array([1, 0.8, 0.5, 0.2, 0.1]) + rng.normal(size=(300, 5))
    plain, weighted = (CCA(dimensions=5, components=5, weighting=a) for a in (0, 0.5))
    maps = plain.learn_maps(first, second), weighted.learn_maps(first, second)
    for side in range(2):
        np.testing.assert_allclose(maps[1][side], maps[0][side] * np.sqrt(plain.correlations_), rtol=1e-9)


@pytest.mark.parametrize("kind", [LDA, CCA])
def test_what_cannot_be_learnt_is_refused(kind):
    reference, query = pairs()
    with pytest.raises(TypeError, match="learns from pairs: call fit_pairs"):
        kind().fit(reference)
    with pytest.raises(NotFittedError, match="fit_pairs was not called"):
        kind(**SIZE).describe(reference)
    with pytest.raises(ValueError, match="160 reference and 150 query images"):
        kind(**SIZE).fit_pairs(reference, query[:150])
    with pytest.raises(ValueError, match=r"dimensions=50 must be in \[1, components=40\]"):
        kind(**SIZE, dimensions=50, components=40).fit_pairs(reference, query)
    with pytest.raises(ValueError, match="components=256, but the images have only 128 pixels"):
        kind(**SIZE).fit_pairs(reference, query)
    with pytest.raises(ValueError, match="components=60, but the pairs span only"):
        kind(**SIZE, dimensions=5, components=60).fit_pairs(reference[:10], query[:10])
    with pytest.raises(ValueError, match=r"shrinkage=0\.0 must be above 0"):
        kind(**SIZE, dimensions=5, components=20, shrinkage=0.0).fit_pairs(reference, query)


def test_other_descriptors_describe_queries_as_they_do_references():
    images, _ = pairs()
    assert np.array_equal(Pixels(**SIZE).describe_query(images), Pixels(**SIZE).describe(images))
    assert Hog(**SIZE).describe_query(images).shape == (160, 256)
