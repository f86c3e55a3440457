"""Statistics against simulated descriptors, images and traverses of which the truth is known, and on real Nordland."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from scipy import stats

from benchmarks import traverse_statistics as module
from benchmarks.traverse_statistics import (
    cross_condition,
    image_statistics,
    place_statistics,
    power_spectrum,
    recall_within_frames,
    residual_statistics,
    spectral_slope,
)

FRAMES, DIMENSIONS = 400, 32


def walk(count, length, correlation, seed=0):
    """Independent stationary AR(1) processes of variance one."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(count, length))
    for t in range(1, count):
        steps[t] = correlation * steps[t - 1] + np.sqrt(1 - correlation**2) * steps[t]
    return steps.astype(np.float32)


def rows(count, length, seed=0):
    return np.random.default_rng(seed).normal(size=(count, length)).astype(np.float32)


@pytest.mark.parametrize("similarity", ["cosine", "euclidean"])
def test_identical_descriptors_are_recalled_whole(similarity):
    places = rows(200, 16)
    assert recall_within_frames(places, places, 0, similarity) == 1


@given(shift=st.integers(0, 6), tolerance=st.integers(0, 6))
def test_a_shifted_traverse_is_recalled_within_the_shift(shift, tolerance):
    places = rows(100, 16)
    recall = recall_within_frames(places, np.roll(places, shift, axis=0), tolerance)
    assert recall == (1 if shift == 0 else (1 - shift / 100) * (shift <= tolerance))


@pytest.mark.parametrize("tolerance", [0, 1, 3])
def test_shuffled_traverses_are_recalled_by_chance(tolerance):
    count, repeats = 300, 20
    places, rng = rows(count, 16), np.random.default_rng(1)
    hits = sum(count * recall_within_frames(places, places[rng.permutation(count)], tolerance) for _ in range(repeats))
    low, high = stats.binom.interval(0.999, count * repeats, (2 * tolerance + 1) / count)
    assert low <= hits <= high


@pytest.fixture(scope="module")
def traverse():
    """Places that change along the track: smooth random images of full rank."""
    coarse = walk(FRAMES, 128, 0.5).reshape(FRAMES, 8, 16).repeat(4, 1).repeat(4, 2)
    fine = np.random.default_rng(1).normal(size=(FRAMES, 32, 64))
    return np.clip(127 + 40 * coarse + 8 * fine, 0, 255).astype(np.uint8)[..., None].repeat(3, 3)


def test_identical_traverses_are_recalled_whole_and_correlate_as_along_the_track(traverse):
    found = place_statistics(traverse, traverse, tolerance=0, dimensions=DIMENSIONS)
    assert set(found.recall) == {f"R@1_pm0f {kind}" for kind in ("pixels", "patch_normalised", "hog", "whitened_pca")}
    assert set(found.recall.values()) == {1.0}
    assert found.cross_condition == pytest.approx({0: 1, 1: found.along_track[1]}, abs=1e-5)
    assert np.isnan(
        [found.residual.participation, found.residual.energy_spread, *found.residual.autocorrelation.values()]
    ).all()
    assert found.reference_images == found.query_images


def test_shuffled_traverses_are_recalled_by_chance_and_do_not_correlate(traverse):
    shuffled = traverse[np.random.default_rng(0).permutation(FRAMES)]
    found = place_statistics(traverse, shuffled, tolerance=5, dimensions=DIMENSIONS)
    low, high = stats.binom.interval(0.9999, FRAMES, 11 / FRAMES)
    assert all(low <= FRAMES * recall <= high for recall in found.recall.values())
    assert all(abs(value) < 0.05 for value in found.cross_condition.values())


@pytest.mark.slow
def test_every_statistic_has_a_row_of_its_own(traverse):
    rows = place_statistics(traverse, traverse[::-1], dimensions=DIMENSIONS).rows()
    assert len(rows) == 1 + 5 + 2 + 1 + 3 + 1 + 4 + 2 * 7
    assert np.isfinite(list(rows.values())).all()


@pytest.mark.parametrize(("first", "second"), [(60, 59), (50, 50)])
def test_traverses_that_are_not_aligned_or_too_short_are_refused(traverse, first, second):
    with pytest.raises(ValueError, match=f"at least 51; got {first} and {second}"):
        place_statistics(traverse[:first], traverse[:second], dimensions=DIMENSIONS)


@given(seed=st.integers(0, 99))
def test_the_cross_condition_correlation_at_a_lag_takes_both_directions(seed):
    first, second = walk(30, 4, 0, seed), walk(30, 4, 0, seed + 100)
    products = second.astype(float) @ first.T.astype(float)
    expected = {lag: (np.diagonal(products, lag).mean() + np.diagonal(products, -lag).mean()) / 2 for lag in (0, 3)}
    assert cross_condition(first, second, (0, 3)) == pytest.approx(expected, abs=1e-6)


def test_independent_gaussian_residuals_spread_evenly():
    found = residual_statistics(walk(20_000, 64, 0))
    assert found.participation == pytest.approx(64, rel=0.01)
    assert found.energy_spread == pytest.approx(np.sqrt(2 / 64), rel=0.03)
    assert found.autocorrelation == pytest.approx({1: 0, 5: 0, 20: 0}, abs=0.01)


def test_the_autocorrelation_of_residuals_is_that_of_their_process():
    found = residual_statistics(walk(20_000, 64, 0.8))
    assert found.autocorrelation == pytest.approx({1: 0.8, 5: 0.8**5, 20: 0.8**20}, abs=0.02)


@given(used=st.integers(1, 16), scale=st.floats(0.01, 100))
def test_participation_counts_the_dimensions_in_use_at_any_scale(used, scale):
    residual = np.zeros((2000, 16), np.float32)
    residual[:, :used] = scale * walk(2000, used, 0)
    assert residual_statistics(residual).participation == pytest.approx(used, rel=0.02)


def test_a_constant_residual_is_no_residual():
    constant = residual_statistics(walk(500, 8, 0) + np.float32(3))
    centred = residual_statistics(walk(500, 8, 0))
    assert constant.participation == pytest.approx(centred.participation, rel=1e-4)
    assert constant.autocorrelation == pytest.approx(centred.autocorrelation, abs=1e-4)


def test_intensity_and_gradients_of_a_ramp_are_known():
    ramp = np.broadcast_to(np.arange(0, 256, 4, dtype=np.uint8), (3, 32, 64))[..., None]
    found = image_statistics(ramp)
    levels = np.arange(0, 256, 4) / 255
    assert (found.intensity_mean, found.intensity_sd) == pytest.approx((levels.mean(), levels.std()), abs=1e-6)
    assert found.gradient_mean == pytest.approx(4 / 255, abs=1e-6)
    assert (found.gradient_median, found.gradient_p90, found.gradient_p99) == pytest.approx((4 / 255,) * 3, abs=4e-4)


def test_percentiles_of_gradients_are_those_of_all_of_them():
    images = np.random.default_rng(0).integers(256, size=(5, 32, 64, 1)).astype(np.uint8)
    grey = images[..., 0] / 255
    magnitude = np.hypot(*np.gradient(grey, axis=(1, 2)))[:, 1:-1, 1:-1]
    found = image_statistics(images)
    percentiles = np.percentile(magnitude, [50, 90, 99])
    assert (found.gradient_median, found.gradient_p90, found.gradient_p99) == pytest.approx(percentiles, abs=1e-3)
    assert found.gradient_mean == pytest.approx(magnitude.mean(), abs=1e-6)


@pytest.mark.parametrize("slope", [0, -2, -3.5])
@pytest.mark.parametrize("size", [(32, 64), (64, 64)])
def test_the_slope_of_a_spectrum_is_found(slope, size):
    """Crops of larger images, whose edges do not meet."""
    rng = np.random.default_rng(0)
    frequency = np.hypot(np.fft.fftfreq(256)[:, None], np.fft.fftfreq(256))
    frequency[0, 0] = 1
    spectrum = np.fft.fft2(rng.normal(size=(60, 256, 256))) * frequency ** (slope / 2)
    images = np.fft.ifft2(spectrum).real[:, : size[0], : size[1]]
    assert spectral_slope(power_spectrum(images).sum(0)) == pytest.approx(slope, abs=0.15)


def test_flat_images_have_no_slope():
    found = image_statistics(np.full((2, 32, 64, 1), 100, np.uint8))
    assert np.isnan(found.spectral_slope)
    assert found.gradient_p99 < 1e-3


def test_chunks_change_nothing(traverse, monkeypatch):
    whole = image_statistics(traverse[:20])
    monkeypatch.setattr(module, "CHUNK", 7)
    assert vars(image_statistics(traverse[:20])) == pytest.approx(vars(whole))


@pytest.mark.slow
@pytest.mark.real_data
def test_the_statistics_of_real_nordland(real_data):
    """Summer reference, winter queries, 2,400 frames; the limits allow for another PCA solver or image library."""
    summer, winter = (
        np.stack([np.asarray(Image.open(file)) for file in sorted((real_data / "nordland" / season).glob("*.png"))])
        for season in ("summer", "winter")
    )
    found = place_statistics(summer, winter)
    assert found.frames == 2400
    assert found.along_track == pytest.approx({1: 0.228, 2: 0.176, 5: 0.136, 10: 0.088, 50: 0.006}, abs=0.005)
    assert found.cross_condition == pytest.approx({0: 0.318, 1: 0.054}, abs=0.005)
    assert found.residual.participation == pytest.approx(67.7, abs=1)
    assert found.residual.autocorrelation == pytest.approx({1: 0.289, 5: 0.191, 20: 0.065}, abs=0.005)
    assert found.residual.energy_spread == pytest.approx(0.290, abs=0.005)
    recall = {"pixels": 0.122, "patch_normalised": 0.173, "hog": 0.261, "whitened_pca": 0.391}
    assert found.recall == pytest.approx({f"R@1_pm1f {name}": value for name, value in recall.items()}, abs=0.01)
    images = (found.reference_images, found.query_images)
    assert [image.intensity_mean for image in images] == pytest.approx([0.377, 0.470], abs=0.002)
    assert [image.spectral_slope for image in images] == pytest.approx([-3.51, -3.37], abs=0.02)
