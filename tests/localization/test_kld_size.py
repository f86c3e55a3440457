import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from sextant.errors import ArgumentError
from sextant.localization.kld_size import KLDSize

WIDE = {"minimum": 1, "maximum": 10**9}


@given(st.integers(2, 5000), st.floats(0.005, 0.5), st.floats(0.001, 0.3))
def test_the_size_is_the_quantile_of_chi_square_over_twice_the_divergence(boxes, epsilon, delta):
    """Fox's bound before the approximation, with SciPy's quantile as the oracle."""
    wanted = int(KLDSize(epsilon, delta, **WIDE).wanted(torch.tensor([boxes]))[0])
    exact = chi2.ppf(1 - delta, boxes - 1) / (2 * epsilon)
    assert wanted == pytest.approx(exact, rel=0.05, abs=1)


def test_the_worked_example():
    """k = 100, epsilon 0.05, delta 0.01: chi-square with 99 degrees has its 99 % quantile at 134.64."""
    assert KLDSize(**WIDE).wanted(torch.tensor([100])).tolist() == [math.ceil(134.64 / 0.1)]


def test_one_box_needs_the_minimum_and_many_no_more_than_the_maximum():
    assert KLDSize(minimum=30, maximum=500).wanted(torch.tensor([1, 10_000])).tolist() == [30, 500]


def test_more_boxes_need_more_particles():
    wanted = KLDSize(**WIDE).wanted(torch.arange(1, 2000))
    assert bool((wanted.diff() > 0).all())


def test_the_divergence_stays_below_epsilon_as_often_as_promised():
    """Draws from a known distribution over 50 boxes, of as many particles as the rule asks for."""
    truth = torch.arange(1, 51, dtype=torch.float64)
    truth /= truth.sum()
    size = KLDSize(epsilon=0.05, delta=0.05, **WIDE)
    count = int(size.wanted(torch.tensor([50]))[0])
    drawn = torch.multinomial(
        truth.expand(2000, -1), count, replacement=True, generator=torch.Generator().manual_seed(0)
    )
    share = torch.stack([torch.bincount(row, minlength=50) for row in drawn]).double() / count
    divergence = torch.xlogy(share, share / truth).sum(1)
    assert float((divergence > 0.05).double().mean()) < 0.07
    assert float((divergence > 0.04).double().mean()) > 0.1


def test_a_minimum_above_the_maximum_is_refused():
    with pytest.raises(ArgumentError, match="minimum=10 must be at most maximum=9"):
        KLDSize(minimum=10, maximum=9)
