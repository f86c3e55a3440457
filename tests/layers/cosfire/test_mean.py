"""Means against numpy's and scipy's."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from layers.cosfire.cosfire_cases import MEANS, random_images
from layers.cosfire.plain_cosfire import averaged

from sextant.errors import UserError
from sextant.layers.cosfire import weighted_mean
from sextant.layers.cosfire.tuples import safe_log, shares


@given(st.integers(1, 9), st.integers(0, 99), st.sampled_from(MEANS), st.booleans())
def test_means_are_those_of_numpy_and_scipy(count, seed, mean, some_zero):
    parts, weights = random_images(seed, count, 3, 4), random_images(seed + 1, count)
    if some_zero:
        parts[0, :2] = 0
    weights = weights / weights.sum()
    expected = averaged(parts.numpy(), weights.numpy(), mean)
    np.testing.assert_allclose(weighted_mean(parts, weights, mean), expected, rtol=1e-12)


@pytest.mark.parametrize("mean", MEANS)
def test_a_mean_of_equals_is_they(mean):
    parts = torch.full((5, 2), 0.3, dtype=torch.float64)
    torch.testing.assert_close(weighted_mean(parts, torch.full((5,), 0.2), mean), parts[0], rtol=1e-7, atol=0)


@pytest.mark.parametrize("mean", MEANS)
def test_gradients_are_those_of_finite_differences_and_finite_at_zero(mean):
    parts = random_images(0, 5, 2, 3).requires_grad_()
    weights = torch.full((5,), 0.2, dtype=torch.float64).requires_grad_(mean not in ("trimmed", "median"))
    assert torch.autograd.gradcheck(lambda p, w: weighted_mean(p, w, mean), (parts, weights))
    missing = parts.detach().clone()
    missing[0] = 0
    missing.requires_grad_()
    weighted_mean(missing, weights, mean).sum().backward()
    assert missing.grad.isfinite().all()
    assert weights.grad is None or weights.grad.isfinite().all()


def test_a_logarithm_of_nothing_is_minus_infinity_without_a_gradient():
    x = torch.tensor([0.0, 2.0], requires_grad=True)
    assert torch.equal(safe_log(x.detach()), safe_log(x).detach())
    safe_log(x)[1:].sum().backward()
    assert x.grad.tolist() == [0.0, 0.5]


def test_shares_sum_to_one_in_each_form_and_negative_weights_count_as_hardly_any():
    form = torch.tensor([0, 0, 1, 1, 1])
    found = shares(torch.tensor([1.0, 3.0, 2.0, 2.0, -5.0]), form, 2)
    torch.testing.assert_close(found, torch.tensor([0.25, 0.75, 0.5, 0.5, 0.0]), rtol=0, atol=1e-8)
    assert (found > 0).all()


def test_unknown_means_and_whole_numbers_are_refused():
    with pytest.raises(ValueError, match="mean must be one of geometric"):
        weighted_mean(torch.ones(3), torch.ones(3) / 3, "mode")
    with pytest.raises(UserError, match=r"floating-point parts, got torch\.int64"):
        weighted_mean(torch.ones(3, dtype=torch.int64), torch.ones(3) / 3, "arithmetic")
