"""Recoveries one step at a time; that the posterior is right is shown with the filter."""

import math

import pytest
import torch
from small_worlds import Told, generator, peaks

from sextant.errors import UserError
from sextant.localization.belief import Belief
from sextant.localization.map_prior import MapPrior
from sextant.localization.recovery import AugmentedMCL, BayesRestart, NoRecovery, TopKInjection, UniformInjection
from sextant.localization.weighted_belief import WeightedBelief

MAP = torch.zeros(50, 3, dtype=torch.float64)
MAP[:, 0] = torch.arange(50)
PRIOR = MapPrior(MAP, (0.0, 0.0), 0.0)
PARTICLES = 200


def weighed(*functions, particles=PARTICLES, seen=None):
    poses = torch.zeros(len(functions), particles, 3, dtype=torch.float64)
    poses[..., 0] = 5.0
    return WeightedBelief.of(Belief.uniform(poses), Told(functions, MAP), seen)


def constant(value):
    return lambda poses: torch.full(poses.shape[:-1], float(value), dtype=torch.float64)


def inject(recovery, step, memory=None, seed=0):
    memory = recovery.memory(len(step.seen)) if memory is None else memory
    return recovery.inject(step, PRIOR, memory, generator(seed))


AWAY = peaks([(30.0, 1.0)], 1.0, 0, floor=1e-6)


def test_no_recovery_adds_nothing():
    injection, memory = inject(NoRecovery(), weighed(AWAY))
    assert injection is None
    assert memory is None


def test_a_restart_is_weighted_by_the_hazard_and_the_evidence_of_the_map():
    injection, _ = inject(BayesRestart(0.01, 0.1), weighed(AWAY))
    evidence = AWAY(MAP).exp().mean()
    assert injection.count.tolist() == [20]
    assert float(injection.log_weights.exp().sum()) == pytest.approx(0.01 * float(evidence))
    assert float(injection.log_kept) == pytest.approx(math.log(0.99))
    assert bool(((injection.poses[..., 0] - 30).abs() < 6).all())


@pytest.mark.parametrize("share", [0.05, 0.2, 0.8])
def test_the_share_of_particles_does_not_change_the_mass_of_restarts(share):
    masses = [inject(BayesRestart(0.01, some), weighed(AWAY))[0].log_weights.logsumexp(1) for some in (share, 0.1)]
    torch.testing.assert_close(*masses)


def test_with_jitter_weighed_the_restarts_are_the_hazard_times_the_prior_times_the_likelihood():
    """Moments of that measure by a sum over a fine grid as the oracle; without the weights they are off."""
    sigma = 0.7
    wide = MapPrior(MAP, (sigma, 0.0), 0.0)
    step = weighed(AWAY, particles=40_000)
    grid = torch.arange(-5, 55, 0.01, dtype=torch.float64)
    density = torch.exp(-0.5 * ((grid - MAP[:, :1]) / sigma) ** 2).mean(0) / (sigma * math.sqrt(2 * math.pi))
    poses = torch.zeros(len(grid), 3, dtype=torch.float64)
    poses[:, 0] = grid
    measure = 0.01 * density * AWAY(poses).exp() * 0.01
    mass = float(measure.sum())
    variance = float((measure * (grid - 30) ** 2).sum()) / mass
    variances = []
    for weigh_jitter in (True, False):
        recovery = BayesRestart(0.01, 0.5, weigh_jitter)
        injection, _ = recovery.inject(step, wide, recovery.memory(1), generator())
        weights = injection.log_weights.exp()
        assert float(weights.sum()) == pytest.approx(mass, rel=0.02)
        variances.append(float((weights * (injection.poses[..., 0] - 30) ** 2).sum() / weights.sum()))
    assert variances[0] == pytest.approx(variance, rel=0.05)
    assert variances[1] > 1.2 * variance


@pytest.mark.parametrize("recovery", [BayesRestart(), TopKInjection()])
@pytest.mark.parametrize("nothing", [-math.inf, math.nan])
def test_an_image_that_no_map_image_explains_restarts_nothing(recovery, nothing):
    injection, _ = inject(recovery, weighed(constant(nothing)))
    assert injection is None


@pytest.mark.parametrize("recovery", [BayesRestart(), TopKInjection()])
def test_runs_that_see_nothing_are_left(recovery):
    injection, _ = inject(recovery, weighed(AWAY, AWAY, seen=torch.tensor([False, True])))
    assert injection.count[0] == 0
    assert injection.count[1] > 0


def test_uniform_injection_takes_its_share_of_the_mass():
    step = weighed(constant(-3.0))
    injection, _ = inject(UniformInjection(0.1), step)
    assert injection.count.tolist() == [20]
    injected = injection.log_weights.exp().sum()
    kept = (step.log_weights + injection.log_kept).exp().sum()
    assert float(injected / (injected + kept)) == pytest.approx(0.1)
    assert float(injection.poses[..., 0].std()) > 10


def test_a_small_share_of_few_particles_is_right_on_average():
    counts = []
    for seed in range(800):
        injection, _ = inject(UniformInjection(0.03), weighed(constant(0.0), particles=10), seed=seed)
        counts.append(0 if injection is None else int(injection.count[0]))
    assert sum(counts) / 800 == pytest.approx(0.3, abs=0.06)
    assert max(counts) == 1


def test_top_k_weighs_by_the_image_that_proposed():
    step = weighed(AWAY)
    injection, _ = inject(TopKInjection(0.1, top=3), step)
    assert set(injection.poses[0, :, 0].tolist()) <= {29.0, 30.0, 31.0}
    expected = AWAY(injection.poses) - math.log(PARTICLES)
    torch.testing.assert_close(injection.log_weights, expected)


@pytest.mark.parametrize("average", ["geometric", "arithmetic"])
def test_averages_are_those_of_the_book_in_logarithms(average):
    """Likelihoods whose product would vanish: the recursion is run on scaled numbers as the oracle."""
    recovery = AugmentedMCL(0.01, 0.2, average)
    levels = torch.cat([torch.zeros(5), torch.linspace(0, 6, 20)]).double()
    scale = -4000.0
    memory = recovery.memory(1)
    expected = None
    for level in levels:
        told = level.exp() if average == "arithmetic" else level
        alpha = torch.tensor([0.01, 0.2]).double()
        expected = told.expand(2) if expected is None else expected + alpha * (told - expected)
        injection, memory = inject(recovery, weighed(constant(scale + float(level))), memory)
        assert injection is None  # it fits better and better
        in_logs = expected.log() if average == "arithmetic" else expected
        torch.testing.assert_close(memory[0] - scale, in_logs, rtol=0, atol=1e-6)


@pytest.mark.parametrize("average", ["geometric", "arithmetic"])
def test_a_worse_fit_injects_by_the_ratio_and_forgets(average):
    recovery = AugmentedMCL(0.01, 0.5, average)
    memory = recovery.memory(2)
    for _ in range(3):
        injection, memory = inject(recovery, weighed(constant(-100.0), constant(-100.0)), memory)
        assert injection is None
    injection, after = inject(recovery, weighed(constant(-101.0), constant(-100.0)), memory)
    if average == "geometric":
        share = 1 - math.exp((0.5 - 0.01) * -1.0)
    else:
        share = 1 - (0.5 + 0.5 * math.exp(-1)) / (0.99 + 0.01 * math.exp(-1))
    assert int(injection.count[0]) == pytest.approx(share * PARTICLES, abs=1)
    assert int(injection.count[1]) == 0
    assert bool(after[0].isnan().all())
    torch.testing.assert_close(after[1], torch.full((2,), -100.0).double())


def test_the_share_is_bounded():
    recovery = AugmentedMCL(0.01, 0.9, most=0.3)
    _, memory = inject(recovery, weighed(constant(0.0)))
    injection, _ = inject(recovery, weighed(constant(-500.0)), memory)
    assert int(injection.count[0]) == pytest.approx(0.3 * PARTICLES, abs=1)


def test_an_image_that_explains_nothing_does_not_enter_the_averages():
    recovery = AugmentedMCL()
    _, memory = inject(recovery, weighed(constant(-7.0)))
    _, after = inject(recovery, weighed(constant(-math.inf)), memory)
    torch.testing.assert_close(after, memory)
    _, empty = inject(recovery, weighed(constant(-math.inf)))
    assert not (empty == -math.inf).any()


def test_a_slow_average_that_is_the_faster_is_refused():
    with pytest.raises(UserError, match="alpha_slow"):
        AugmentedMCL(0.1, 0.01)
