"""Distortion against numpy's roots of the polynomial, and its inverse's gradients against finite differences."""

import numpy as np
import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st

from sextant.errors import UserError
from sextant.geometry import (
    distort_radius,
    distortion_factor,
    k2_of_k1,
    max_distorted_radius,
    max_radius,
    undistort_radius,
)

coefficients = st.floats(-0.5, 0.5)


def f64(*values):
    return [torch.tensor(value, dtype=torch.float64) for value in values]


def fold_by_numpy(k1, k2):
    """The square root of the smallest positive root of 1 + 3 k1 s + 5 k2 s^2."""
    roots = np.roots([5 * k2, 3 * k1, 1])
    roots = roots.real[(abs(roots.imag) < 1e-12) & (roots.real > 0)]
    return float(np.sqrt(roots.min())) if roots.size else np.inf


def test_the_families():
    k1, other = f64([-0.4, -0.1, 0.0, 0.2], [0.1, 0.2, 0.3, 0.4])
    torch.testing.assert_close(k2_of_k1(k1), f64([0.1212, 0.00615, 0.0, 0.036])[0])
    assert torch.equal(k2_of_k1(k1, "zero"), torch.zeros_like(k1))
    assert k2_of_k1(k1, "free", other) is other


@pytest.mark.parametrize(
    ("family", "k2", "says"),
    [("free", None, "needs a value"), ("lopez", 0.1, "fixes k2"), ("zero", 0.1, "fixes k2"), ("cubic", None, "one of")],
)
def test_a_family_is_refused_without_what_it_needs(family, k2, says):
    with pytest.raises(UserError, match=says):
        k2_of_k1(torch.zeros(2), family, None if k2 is None else torch.full((2,), k2))


@given(st.floats(-3, 3), coefficients, coefficients)
def test_the_distorted_radius_is_the_polynomial(radius, k1, k2):
    distorted = distort_radius(*f64(radius, k1, k2)).item()
    assert distorted == pytest.approx(np.polyval([k2, 0, k1, 0, 1, 0], radius), abs=1e-12)
    factor = distortion_factor(*f64(radius**2, k1, k2)).item()
    assert distorted == pytest.approx(radius * factor, abs=1e-12)


@given(coefficients, coefficients)
@example(-0.4, 0.0)
@example(0.0, -0.1)
@example(0.3, -0.1)
@example(0.3, -1e-9)
@example(-0.3, -0.1)
@example(0.0, 0.0)
def test_the_fold_is_the_first_turning_point(k1, k2):
    if abs(9 * k1 * k1 - 20 * k2) < 1e-6 or 0 < max(abs(k1), abs(k2)) < 1e-6:
        return  # the roots of numpy are then not exact
    assert max_radius(*f64(k1, k2)).item() == pytest.approx(fold_by_numpy(k1, k2), rel=1e-6)


def test_what_is_known_of_the_folds_of_the_families():
    k1 = torch.linspace(-0.4, 0, 4001, dtype=torch.float64)
    lopez = max_radius(k1, k2_of_k1(k1))
    assert lopez[k1 < -0.0536].isinf().all()
    assert lopez.min().item() == pytest.approx(3.26, abs=0.01)
    k1, k2 = f64(-0.4, 0.0)
    assert torch.rad2deg(max_radius(k1, k2).atan()).item() == pytest.approx(42.4, abs=0.05)
    assert max_distorted_radius(k1, k2).item() == pytest.approx(0.609, abs=5e-4)
    assert max_distorted_radius(k1, k2_of_k1(k1)).isinf()


@pytest.mark.parametrize(
    ("k1", "limit"), [(-0.2, 1.0), (-0.4, 1.0), (-0.4, 1.5), (-0.4, 2.0), (-0.3, 2.0), (0.2, 1.5), (-0.06, 20.0)]
)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_undistortion_is_exact_where_a_fixed_point_iteration_diverges(k1, limit, dtype):
    k1 = torch.tensor(k1, dtype=dtype)
    radius = torch.linspace(-limit, limit, 2001, dtype=dtype)
    found = undistort_radius(distort_radius(radius, k1, k2_of_k1(k1)), k1, k2_of_k1(k1))
    assert found.dtype == dtype
    condition = 10 if k1 == -0.06 else 2  # there the slope gets as small as 0.08
    assert (found - radius).abs().max() <= condition * torch.finfo(dtype).eps * max(limit, 1)


@given(st.floats(0, 50), st.floats(-2, 2), st.floats(-2, 2))
@example(10.0, 1000.0, 0.0)
@example(3.0, -1e-9, 0.0)
def test_the_root_is_on_the_rising_branch_for_any_coefficients(distorted, k1, k2):
    distorted, k1, k2 = f64(distorted, k1, k2)
    reachable = torch.minimum(distorted, max_distorted_radius(k1, k2))
    radius = undistort_radius(distorted, k1, k2)
    torch.testing.assert_close(distort_radius(radius, k1, k2), reachable, rtol=1e-13, atol=1e-300)
    assert radius <= max_radius(k1, k2)
    assert radius <= 2.2500001 * distorted


@pytest.mark.parametrize("distorted", [0.61, 1.0, 1e6])
def test_out_of_reach_is_the_fold_with_bounded_gradients(distorted):
    distorted, k1, k2 = (value.requires_grad_() for value in f64(distorted, -0.4, 0.0))
    radius = undistort_radius(distorted, k1, k2)
    assert radius == max_radius(k1, k2)
    by_distorted, by_k1, by_k2 = torch.autograd.grad(radius, [distorted, k1, k2])
    assert by_distorted == 20
    torch.testing.assert_close(by_k1, -20 * radius**3)
    torch.testing.assert_close(by_k2, -20 * radius**5)


def test_no_entry_depends_on_the_others_and_nan_stays_alone():
    distorted, k1, k2 = f64([0.5, 0.3, float("nan"), 7.0, 0.0], [-0.4, 0.1, 0.1, -0.1, 0.3], [0.0, 0.2, 0.1, 0.1, 0.0])
    together = undistort_radius(distorted, k1, k2)
    alone = torch.stack([undistort_radius(*entry) for entry in zip(distorted, k1, k2, strict=True)])
    assert together.isnan().tolist() == [False, False, True, False, False]
    assert torch.equal(together.nan_to_num(), alone.nan_to_num())
    assert undistort_radius(torch.empty(0), torch.zeros(1), torch.zeros(1)).shape == (0,)


def test_gradients_of_first_and_second_order_are_those_of_finite_differences():
    distorted, k1, k2 = f64([[0.0, 0.4, -0.9, 1.6]], [[-0.4], [-0.2], [0.0], [0.3]], [[0.1], [0.2], [0.05], [-0.01]])
    inputs = [value.requires_grad_() for value in (distorted, k1, k2)]
    assert torch.autograd.gradcheck(undistort_radius, inputs)
    assert torch.autograd.gradgradcheck(undistort_radius, inputs)
    assert torch.autograd.gradcheck(lambda k: undistort_radius(distorted.detach(), k, k2_of_k1(k)), [k1])
    folding = [value.requires_grad_() for value in f64([-0.3, 0.0, 0.2, -0.2], [0.0, -0.1, -0.1, 0.01])]
    assert torch.autograd.gradcheck(max_radius, folding)


def test_with_the_lopez_family_the_gradient_is_the_closed_form():
    k1 = torch.tensor(-0.3, dtype=torch.float64, requires_grad=True)
    r = undistort_radius(torch.tensor(0.8, dtype=torch.float64), k1, k2_of_k1(k1))
    (gradient,) = torch.autograd.grad(r, k1)
    slope = 1 + 3 * k1 * r**2 + 5 * k2_of_k1(k1) * r**4
    torch.testing.assert_close(gradient, -(r**3 + (0.019 + 1.61 * k1) * r**5) / slope)


def test_the_steps_of_an_exported_graph_are_enough_except_next_to_the_fold(monkeypatch):
    k1 = torch.linspace(-0.4, 0.2, 61)[:, None].expand(-1, 200)
    k2 = k2_of_k1(k1)
    distorted = torch.linspace(0, 0.999, 200) * max_distorted_radius(k1, k2).clamp(max=2.0)
    wanted = undistort_radius(distorted, k1, k2)
    monkeypatch.setattr(torch.compiler, "is_exporting", lambda: True)
    torch.testing.assert_close(undistort_radius(distorted, k1, k2), wanted, rtol=0, atol=1e-5)
