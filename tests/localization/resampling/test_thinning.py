import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from small_worlds import generator

from sextant.localization.resampling import thin

weight_lists = st.lists(st.floats(-25, 3) | st.just(-1.0), min_size=1, max_size=40)


@given(weight_lists, st.data())
def test_k_survive_and_the_sum_of_the_weights_stays(log_weights, data):
    keep = data.draw(st.integers(1, len(log_weights)))
    seed = data.draw(st.integers(0, 1000))
    log_weights = torch.tensor([log_weights], dtype=torch.float64)
    survivors, thinned = thin(log_weights, torch.tensor([keep]), generator(seed))
    assert int(survivors.sum()) == keep
    assert bool((thinned[~survivors] == -math.inf).all())
    torch.testing.assert_close(thinned.logsumexp(1), log_weights.logsumexp(1), rtol=0, atol=1e-6)


def threshold_by_bisection(weights, keep):
    """The largest c with sum min(w/c, 1) = K, in its logarithm."""
    low, high = float(weights.min().log()) - 1, float(weights.sum().log()) + 1
    for _ in range(200):
        middle = (low + high) / 2
        enough = float((weights / math.exp(middle)).clamp(max=1).sum()) >= keep - 1e-12
        low, high = (middle, high) if enough else (low, middle)
    return math.exp(low)


@given(weight_lists, st.data())
def test_the_threshold_solves_its_equation(log_weights, data):
    """Who is heavier than c stays as it is, who is lighter weighs c or nothing."""
    keep = data.draw(st.integers(1, len(log_weights)))
    weights = torch.tensor(log_weights, dtype=torch.float64).exp()
    _, thinned = thin(weights.log()[None], torch.tensor([keep]), generator())
    c = threshold_by_bisection(weights, keep)
    for before, after in zip(weights.tolist(), thinned[0].exp().tolist(), strict=True):
        assert after == 0 or after == pytest.approx(max(before, c), rel=1e-6)
        if before > c * (1 + 1e-6):
            assert after == pytest.approx(before)


def test_expected_weights_do_not_change():
    log_weights = torch.randn(1, 30, dtype=torch.float64, generator=generator(4)) * 2
    runs = 20_000
    _, thinned = thin(log_weights.expand(runs, -1), torch.full((runs,), 12), generator())
    weights = thinned.exp()
    error = weights.std(0) / math.sqrt(runs)
    assert bool(((weights.mean(0) - log_weights[0].exp()).abs() <= 5 * error + 1e-9).all())


def test_heavy_particles_always_survive_unchanged():
    log_weights = torch.tensor([[0.0, -0.1, -8.0, -8.0, -8.0, -8.0]], dtype=torch.float64).expand(500, -1)
    survivors, thinned = thin(log_weights, torch.full((500,), 4), generator())
    assert bool(survivors[:, :2].all())
    assert torch.equal(thinned[:, :2], log_weights[:, :2])
    assert bool((survivors[:, 2:].sum(1) == 2).all())


@given(st.integers(1, 10), st.integers(0, 10), st.integers(1, 25))
def test_all_that_weigh_something_survive_where_there_is_room(alive, dead, room):
    log_weights = torch.cat([torch.linspace(-3, 0, alive), torch.full((dead,), -math.inf)]).double()[None]
    survivors, thinned = thin(log_weights, torch.tensor([alive + room]), generator())
    assert survivors[0].tolist() == [True] * alive + [False] * dead
    torch.testing.assert_close(thinned, log_weights)


def test_a_run_without_weight_keeps_nobody_and_harms_no_other():
    log_weights = torch.zeros(2, 5, dtype=torch.float64)
    log_weights[0] = -math.inf
    survivors, thinned = thin(log_weights, torch.tensor([3, 3]), generator())
    assert survivors.sum(1).tolist() == [0, 3]
    assert not thinned.isnan().any()


@given(st.floats(-1e5, 1e5))
def test_a_constant_changes_nothing(constant):
    log_weights = torch.randn(2, 30, dtype=torch.float64, generator=generator(1))
    survivors, thinned = thin(log_weights, torch.tensor([10, 20]), generator(2))
    shifted_survivors, shifted = thin(log_weights + constant, torch.tensor([10, 20]), generator(2))
    assert torch.equal(survivors, shifted_survivors)
    torch.testing.assert_close(thinned[survivors] + constant, shifted[survivors])
