import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from sextant.chapters.calibration.metrics.fusion import Prior, fuse, with_prior


def photos(rng, n, sigma=(0.05, 0.1), truth=(0.2, -0.3)):
    sigmas = np.abs(rng.normal(1, 0.3, (n, 2)).clip(0.3)) * sigma
    return np.asarray(truth) + sigmas * rng.standard_normal((n, 2)), sigmas


def test_without_correlation_it_is_generalised_least_squares():
    values, sigmas = photos(np.random.default_rng(0), 6)
    fused = fuse(values, sigmas, correlation=0.0)
    for k in range(2):
        weights = np.diag(1 / sigmas[:, k] ** 2)
        ones = np.ones((6, 1))
        variance = np.linalg.inv(ones.T @ weights @ ones)
        assert fused.values[k] == pytest.approx((variance @ ones.T @ weights @ values[:, k]).item(), rel=1e-12)
        assert fused.sigmas[k] == pytest.approx(variance.item() ** 0.5, rel=1e-12)


def test_with_correlation_the_error_is_that_of_the_full_covariance():
    values, sigmas = photos(np.random.default_rng(1), 5)
    fused = fuse(values, sigmas, correlation=0.4)
    for k in range(2):
        covariance = np.outer(sigmas[:, k], sigmas[:, k]) * (0.4 + 0.6 * np.eye(5))
        weights = 1 / sigmas[:, k] ** 2 / (1 / sigmas[:, k] ** 2).sum()
        assert fused.sigmas[k] == pytest.approx((weights @ covariance @ weights) ** 0.5, rel=1e-12)


@given(st.integers(0, 10_000), st.integers(1, 8))
def test_the_order_of_photos_and_the_units_do_not_matter(seed, n):
    rng = np.random.default_rng(seed)
    values, sigmas = photos(rng, n)
    order = rng.permutation(n)
    first, turned = fuse(values, sigmas), fuse(values[order], sigmas[order])
    np.testing.assert_allclose(first.values, turned.values, rtol=1e-9)
    scaled = fuse(7 * values, 7 * sigmas)
    np.testing.assert_allclose(scaled.sigmas, 7 * first.sigmas, rtol=1e-9)
    assert scaled.chi_square == pytest.approx(first.chi_square, rel=1e-6, abs=1e-9)


def test_one_photo_is_left_as_it_is():
    fused = fuse(np.array([[0.3, -0.2]]), np.array([[0.1, 0.2]]))
    np.testing.assert_allclose(fused.values, [0.3, -0.2])
    np.testing.assert_allclose(fused.sigmas, [0.1, 0.2])
    assert fused.consistent
    assert fused.p_value == 1


def test_the_consistency_test_rejects_as_often_as_it_says():
    rng = np.random.default_rng(2)
    p = np.array([fuse(*photos(rng, 2), level=1e-9).p_value for _ in range(2000)])
    assert stats.kstest(p, "uniform").pvalue > 0.001
    assert (p < 0.05).mean() == pytest.approx(0.05, abs=0.015)


def test_intervals_cover_when_errors_are_correlated_as_assumed():
    rng, hits = np.random.default_rng(3), []
    for _ in range(2000):
        common = rng.standard_normal(2) * 0.25**0.5
        values = 0.1 * (common + 0.75**0.5 * rng.standard_normal((6, 2)))
        fused = fuse(values, np.full((6, 2), 0.1), correlation=0.25, level=1e-9)
        hits.append(np.abs(fused.values) < fused.sigmas)
    assert np.mean(hits) == pytest.approx(0.683, abs=0.025)


def test_many_photos_do_not_make_it_certain():
    fused = fuse(np.zeros((10_000, 1)), np.ones((10_000, 1)))
    assert fused.sigmas[0] == pytest.approx(0.5, abs=0.001)


@pytest.mark.parametrize("column", [0, 1])
def test_one_outlier_is_found_and_left_out(column):
    values, sigmas = photos(np.random.default_rng(4), 6)
    values[2, column] += 12 * sigmas[2, column]
    fused = fuse(values, sigmas)
    assert fused.kept.tolist() == [True, True, False, True, True, True]
    assert fused.consistent
    np.testing.assert_allclose(fused.values, fuse(np.delete(values, 2, 0), np.delete(sigmas, 2, 0)).values)


def test_of_two_photos_that_disagree_none_is_left_out_but_the_error_grows():
    values, sigmas = np.array([[0.0], [10.0]]), np.ones((2, 1))
    fused = fuse(values, sigmas, correlation=0.0)
    assert fused.kept.all()
    assert not fused.consistent
    assert fused.values[0] == pytest.approx(5)
    # Birge's ratio makes the standard error that of the scatter: sd / sqrt(n)
    assert fused.sigmas[0] == pytest.approx(np.std(values, ddof=1) / 2**0.5)


def test_two_outliers_are_not_made_to_agree():
    values = np.array([[0.0], [0.1], [8.0], [-9.0]])
    fused = fuse(values, np.ones((4, 1)))
    assert not fused.consistent
    assert fused.kept.all()
    assert fused.sigmas[0] > 2


def test_a_photo_that_says_nothing_changes_nothing():
    values, sigmas = photos(np.random.default_rng(5), 4)
    silent = fuse(np.vstack([values, [[9.0, 9.0]]]), np.vstack([sigmas, [[np.inf, np.inf]]]))
    alone = fuse(values, sigmas)
    np.testing.assert_allclose(silent.values, alone.values, rtol=1e-12)
    np.testing.assert_allclose(silent.sigmas, alone.sigmas, rtol=1e-12)
    assert silent.degrees == alone.degrees


def test_a_prior_is_one_more_independent_estimate():
    fused = with_prior(fuse(np.array([[1.0, 5.0]]), np.array([[0.2, 0.3]])), 0, Prior(2.0, 0.1))
    both = fuse(np.array([[1.0], [2.0]]), np.array([[0.2], [0.1]]), correlation=0.0, level=1e-9)
    assert fused.values[0] == pytest.approx(both.values[0])
    assert fused.sigmas[0] == pytest.approx(both.sigmas[0])
    assert fused.prior_z == pytest.approx(1 / np.hypot(0.1, 0.2))
    assert (fused.values[1], fused.sigmas[1]) == (5.0, pytest.approx(0.3))


@pytest.mark.parametrize(
    ("values", "sigmas"),
    [
        (np.zeros((0, 2)), np.zeros((0, 2))),
        (np.array([[np.nan]]), np.ones((1, 1))),
        (np.zeros((2, 1)), np.array([[1.0], [0.0]])),
        (np.zeros((2, 1)), np.full((2, 1), np.inf)),
    ],
)
def test_what_cannot_be_fused_is_refused(values, sigmas):
    with pytest.raises(ValueError, match=r"need values|must be finite"):
        fuse(values, sigmas)
