import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import TypeCheckError

from sextant.errors import UserError
from sextant.localization.belief import Belief


def poses(runs, particles):
    return torch.zeros(runs, particles, 3, dtype=torch.float64)


@given(st.lists(st.floats(-700, 700), min_size=1, max_size=30), st.floats(-1e4, 1e4))
def test_weights_sum_to_one_and_do_not_depend_on_a_constant(log_weights, constant):
    given_weights = torch.tensor([log_weights], dtype=torch.float64)
    belief = Belief.of(poses(1, len(log_weights)), given_weights)
    shifted = Belief.of(poses(1, len(log_weights)), given_weights + constant)
    assert float(belief.weights.sum()) == pytest.approx(1)
    torch.testing.assert_close(belief.log_weights, shifted.log_weights, rtol=0, atol=1e-8)
    assert 1 - 1e-9 <= float(belief.ess()[0]) <= len(log_weights) + 1e-9


@given(st.integers(1, 200), st.integers(1, 200))
def test_the_effective_sample_is_what_is_left_when_some_weigh_nothing(alive, dead):
    log_weights = torch.cat([torch.zeros(alive), torch.full((dead,), -math.inf)]).double()[None]
    assert float(Belief.of(poses(1, alive + dead), log_weights).ess()[0]) == pytest.approx(alive)


def test_uniform_weights_have_the_largest_effective_sample():
    torch.testing.assert_close(Belief.uniform(poses(2, 7)).ess(), torch.full((2,), 7.0).double())


@pytest.mark.parametrize("value", [-math.inf, math.nan, math.inf])
def test_a_run_without_a_usable_weight_is_refused(value):
    log_weights = torch.zeros(2, 3, dtype=torch.float64)
    log_weights[1] = value
    with pytest.raises(ValueError, match="each run needs a particle"):
        Belief.of(poses(2, 3), log_weights)


def test_no_particles_are_refused():
    with pytest.raises(ValueError, match="at least one particle"):
        Belief.uniform(poses(2, 0))
    with pytest.raises(ValueError, match="at least one particle"):
        Belief.of(poses(2, 0), poses(2, 0)[..., 0])


@pytest.mark.parametrize(("given", "weights"), [((1, 2, 3), (1, 4)), ((1, 2, 3), (2, 2)), ((1, 2, 2), (1, 2))])
def test_weights_are_those_of_the_poses(given, weights):
    with pytest.raises((UserError, TypeCheckError), match=r"must have|Type-check error"):
        Belief.of(torch.zeros(given).double(), torch.zeros(weights).double())
