import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.baselines.calibration.lens import apparent_k2, distort_points, undistort_factor, undistort_points
from sextant.geometry import k2_of_k1, perspective_bearings, undistort_radius


@given(st.floats(-0.6, 0.2), st.floats(0.4, 2.5))
def test_it_is_the_packages_lens_in_image_heights(k1, focal):
    points = np.random.default_rng(0).uniform(-0.7, 0.7, (50, 2))
    f, k = torch.tensor([focal, k1], dtype=torch.float64)
    rays = perspective_bearings(torch.as_tensor(points), f, k, k2_of_k1(k)).numpy()
    k1_hat = k1 / focal**2
    ours = undistort_points(points, k1_hat, apparent_k2(k1_hat, focal))
    np.testing.assert_allclose(ours, focal * rays[:, :2] / rays[:, 2:], rtol=1e-9, atol=1e-12)


@given(st.floats(-1.8, 0.4))
def test_distortion_undoes_undistortion_and_no_lens_does_nothing(k1_hat):
    points = np.random.default_rng(1).uniform(-1, 1, (50, 2))
    k2_hat = float(apparent_k2(k1_hat, 1.0))
    np.testing.assert_allclose(
        distort_points(undistort_points(points, k1_hat, k2_hat), k1_hat, k2_hat), points, atol=1e-9
    )
    np.testing.assert_array_equal(undistort_points(points, 0.0, 0.0), points)


@given(st.floats(-2.5, 1.0), st.floats(0.25, 4.0), st.floats(0.01, 1.1))
def test_short_lenses_that_fold_end_at_the_fold(k1_hat, focal, radius):
    """Of 0.15 heights and k1_hat = -0.5 no ray comes as far out as the corner: there is no root to find."""
    k2_hat = float(apparent_k2(k1_hat, focal))
    exact = float(undistort_radius(*torch.tensor([radius, k1_hat, k2_hat], dtype=torch.float64)))
    assert radius * float(undistort_factor(np.array(radius**2), k1_hat, k2_hat)) == pytest.approx(exact, rel=1e-5)


def test_a_lens_that_does_not_reach_the_corner_ends_at_its_fold():
    ratio = undistort_factor(np.array([0.2, 1.04]), -0.5, apparent_k2(-0.5, 0.15))
    k1_hat, k2_hat, radii = -0.5, float(apparent_k2(-0.5, 0.15)), np.sqrt([0.2, 1.04])
    exact = [float(undistort_radius(*torch.tensor([r, k1_hat, k2_hat], dtype=torch.float64))) for r in radii]
    assert ratio * radii == pytest.approx(exact, rel=1e-6)
