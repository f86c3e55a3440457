"""What a robot would have seen on its way, against sums over explicit paths; and restarts weighed by it."""

import math

import pytest
import torch
from small_worlds import Told, peaks

from sextant.geometry.planar import se2_compose
from sextant.localization.belief import Belief
from sextant.localization.initialisation import GaussianStart
from sextant.localization.map_prior import MapPrior
from sextant.localization.motion import ExponentialMotion
from sextant.localization.particle_filter import ParticleFilter
from sextant.localization.recovery import BayesRestart
from sextant.localization.recovery.bayes_restart import Trail
from sextant.localization.resampling import SystematicResampling
from sextant.localization.weighted_belief import WeightedBelief

PLACES = 400
MAP = torch.zeros(PLACES, 3, dtype=torch.float64)
MAP[:, 0] = torch.arange(PLACES)
PRIOR = MapPrior(MAP, (0.2, 0.0), 0.0)


def rows(*values):
    return torch.tensor(values, dtype=torch.float64)


def looks(poses):
    """A log-likelihood that depends on all of a pose."""
    return torch.sin(3 * poses[..., 0]) + torch.cos(2 * poses[..., 1]) + torch.sin(poses[..., 2] + 1)


def test_worth_is_the_sum_over_paths_that_turn():
    """Three observations of two runs; poses are moved forward from the oldest, as the oracle."""
    motions = [rows((1.0, 0.5, 0.7), (0.0, -1.0, 2.0)), rows((-0.3, 0.2, 1.1), (2.0, 0.0, -0.4))]
    foreseen = [rows(-0.4, 0.3), rows(0.2, -0.1)]
    oldest = torch.randn(2, 5, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    middle = se2_compose(oldest, motions[0][:, None])
    now = se2_compose(middle, motions[1][:, None])
    trail, everyone = Trail(), torch.ones(2, dtype=torch.bool)
    for motion, log_evidence in zip(motions, foreseen, strict=True):
        trail = trail.updated(Told([looks, looks], MAP), log_evidence, everyone, 5).moved(motion)
    one = (looks(middle) - foreseen[1][:, None]).exp()
    two = one * (looks(oldest) - foreseen[0][:, None]).exp()
    torch.testing.assert_close(trail.log_worth(now), (1 + one + two).log())


def test_an_unknown_motion_ends_the_trail_of_its_run_alone():
    trail = Trail().updated(Told([looks, looks], MAP), rows(0.0, 0.0), torch.ones(2, dtype=torch.bool), 5)
    worth = trail.moved(rows((math.nan, 0.0, 0.0), (0.0, 0.0, 0.0))).log_worth(MAP[None, :3].expand(2, -1, -1))
    assert worth[0].tolist() == [0, 0, 0]
    torch.testing.assert_close(worth[1], (1 + looks(MAP[:3]).exp()).log())


@pytest.mark.parametrize(
    ("log_evidence", "seen"), [(rows(0.0), torch.tensor([False])), (rows(-math.inf), torch.tensor([True]))]
)
def test_what_was_not_seen_or_was_dropped_tells_nothing(log_evidence, seen):
    trail = Trail().updated(Told([looks], MAP), log_evidence, seen, 5)
    assert trail.log_worth(MAP[None, :4]).tolist() == [[0, 0, 0, 0]]


def test_a_pose_whose_way_left_the_map_is_worth_what_it_shows_since():
    trail = Trail().updated(
        Told([lambda poses: torch.full(poses.shape[:-1], math.nan)], MAP), rows(0.0), torch.tensor([True]), 5
    )
    assert trail.log_worth(MAP[None, :4]).tolist() == [[0, 0, 0, 0]]


def test_only_the_latest_are_kept():
    trail = Trail()
    for _ in range(7):
        trail = trail.updated(Told([looks], MAP), rows(0.0), torch.tensor([True]), 3)
    assert len(trail.passed) == 3


def test_a_kidnapping_counts_once_over_all_steps_that_think_of_it():
    """Images that tell nothing: the mass of all restarts of a step is the hazard, once the window is full."""
    recovery = BayesRestart(0.01, 0.1, window=4)
    memory, masses = recovery.memory(1), []
    belief = Belief.uniform(MAP[None].clone())
    for _ in range(7):
        memory = recovery.moved(memory, rows((1.0, 0.0, 0.0)))
        told = Told([lambda poses: torch.zeros(poses.shape[:-1], dtype=torch.float64)], MAP)
        injection, memory = recovery.inject(
            WeightedBelief.of(belief, told, None), PRIOR, memory, torch.Generator().manual_seed(0)
        )
        masses.append(float(injection.log_weights.exp().sum()))
    assert masses[-1] == pytest.approx(0.01, rel=0.01)
    assert masses[0] == pytest.approx(0.01 / 5)


def test_without_odometry_a_window_changes_nothing():
    """Of two runs the second has none: its restarts weigh what they weigh without a window."""
    told = Told([looks, looks], MAP)
    masses = []
    for window in (0, 4):
        recovery = BayesRestart(0.01, 0.1, window=window)
        memory = recovery.memory(2)
        for _ in range(6):
            memory = recovery.moved(memory, rows((1.0, 0.0, 0.0), (math.nan, 0.0, 0.0)))
            step = WeightedBelief.of(Belief.uniform(MAP[None].repeat(2, 1, 1)), told, None)
            injection, memory = recovery.inject(step, PRIOR, memory, torch.Generator().manual_seed(0))
        masses.append(injection.log_weights.logsumexp(1))
    torch.testing.assert_close(masses[0][1], masses[1][1])
    assert abs(float(masses[0][0] - masses[1][0])) > 0.01


def nothing(poses):
    return torch.zeros(poses.shape[:-1], dtype=torch.float64)


def masses_of_restarts(steps, runs=1, window=4):
    """Of images that tell nothing, for steps of motions (or None) and whether each run sees (or None: nobody does)."""
    recovery, masses = BayesRestart(0.01, 0.1, window=window), []
    memory = recovery.memory(runs)
    for motion, seen in steps:
        if motion is not None:
            memory = recovery.moved(memory, motion)
        if seen is None:
            continue
        step = WeightedBelief.of(Belief.uniform(MAP[None].repeat(runs, 1, 1)), Told([nothing] * runs, MAP), seen)
        injection, memory = recovery.inject(step, PRIOR, memory, torch.Generator().manual_seed(0))
        masses.append([round(float(mass), 6) for mass in injection.log_weights.exp().sum(1)])
    return masses


def test_a_run_that_sees_every_other_image_has_a_window_of_its_own():
    forward = rows((1.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    together = masses_of_restarts([(forward, torch.tensor([True, k % 2 == 0])) for k in range(12)], runs=2)
    assert [mass for mass, _ in together[5:]] == pytest.approx([0.01] * 7, rel=0.01)
    assert [mass for _, mass in together[8::2]] == pytest.approx([0.01] * 2, rel=0.01)


def test_once_odometry_is_there_again_a_kidnapping_counts_once():
    """In the step after the gap whole, then in n + 1 steps a part each, of those after it alone."""
    everyone, forward, unknown = torch.tensor([True]), rows((1.0, 0.0, 0.0)), rows((math.nan, 0.0, 0.0))
    masses = masses_of_restarts([(forward, everyone)] * 6 + [(unknown, everyone)] + [(forward, everyone)] * 6)
    expected = [0.002, 0.004, 0.006, 0.008, 0.01, 0.01, 0.01, 0.002, 0.004, 0.006, 0.008, 0.01, 0.01]
    assert [mass for (mass,) in masses] == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("between", [[], [(None, None)], [(rows((1.0, 0.0, 0.0)), None)]])
def test_a_motion_is_unknown_until_the_next_image_whatever_follows_it(between):
    everyone, unknown = torch.tensor([True]), rows((math.nan, 0.0, 0.0))
    masses = masses_of_restarts([(unknown, None), *between, (None, everyone), (None, everyone), (None, everyone)])
    assert [mass for (mass,) in masses] == pytest.approx([0.01, 0.002, 0.004], rel=0.01)


def test_a_restart_that_has_no_likelihood_does_not_take_the_image_from_the_trail():
    def partly(poses):
        return torch.where(poses[..., 1].abs() > 0.2, math.nan, nothing(poses))

    recovery = BayesRestart(0.01, 0.5, window=4)
    prior = MapPrior(MAP, (0.2, 0.2), 0.0)
    step = WeightedBelief.of(Belief.uniform(MAP[None].clone()), Told([partly], MAP), None)
    injection, memory = recovery.inject(step, prior, recovery.memory(1), torch.Generator().manual_seed(0))
    assert (injection.log_weights == -math.inf).any()
    assert not injection.log_weights.isnan().any()
    assert memory.passed[0].counts.tolist() == [True]


def frames_until_found(window, seed):
    """A robot of 200 particles, sure of a wrong place; each image looks like the true place and like 80 others."""
    chance = torch.Generator().manual_seed(seed)
    filter = ParticleFilter(
        ExponentialMotion((0.05, 0.0, 0.0)), SystematicResampling(), BayesRestart(0.001, 0.1, window=window), PRIOR
    )
    start = GaussianStart(rows((20.0, 0.0, 0.0)), (0.5, 0.0, 0.0))
    state = filter.start(start, 1, 200, chance)
    for step in range(60):
        true = 200.0 + step
        others = torch.randint(PLACES, (80,), generator=chance).tolist()
        image = peaks([(true, 1.0), *((float(other), 1.0) for other in others)], 0.7, 0, floor=0.1)
        motion = rows((1.0, 0.0, 0.0)) if step else None
        state, _ = filter.step(state, motion, Told([image], MAP), None, chance)
        if float(state.belief.weights[(state.belief.poses[..., 0] - true).abs() < 2].sum()) > 0.5:
            return step
    return 60


@pytest.mark.slow
def test_a_window_finds_a_robot_whose_every_image_looks_like_many_places():
    alone, window = ([frames_until_found(n, seed) for seed in range(8)] for n in (0, 10))
    assert sorted(window)[6] <= 15
    assert sum(window) < sum(alone) / 2


@pytest.mark.parametrize("particles", [10, 30, 4000])  # of which one, three and many are restarts
def test_restarts_weigh_in_the_mean_what_their_sum_over_the_map_is_worth(particles):
    recovery, runs = BayesRestart(0.01, 0.1, window=3), max(8, 8000 // particles)
    memory, chance = recovery.memory(runs), torch.Generator().manual_seed(0)
    told = Told([looks] * runs, MAP)
    for _ in range(4):
        known = memory
        weighed = WeightedBelief.of(Belief.uniform(MAP[:1].repeat(runs, particles, 1)), told, None)
        injection, memory = recovery.inject(weighed, MapPrior(MAP, 0.0, 0.0), memory, chance)
        memory = recovery.moved(memory, rows((1.0, 0.0, 0.0)).repeat(runs, 1))
    worth = (told.over_map() + known.log_worth(MAP[None].repeat(runs, 1, 1))).exp().mean(1)
    ratio = injection.log_weights.exp().sum(1) / (0.01 / 4 * worth)
    assert float(ratio.mean()) == pytest.approx(1, abs=0.1)
    assert float(ratio.mean()) == pytest.approx(1, abs=4 * float(ratio.std()) / runs**0.5)
