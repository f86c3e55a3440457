"""Particles around a located pose, against Bayes' rule summed over a grid of all three coordinates."""

import math

import pytest
import torch
from small_worlds import Told, generator

from sextant.errors import UserError
from sextant.localization.belief import Belief
from sextant.localization.map_prior import MapPrior
from sextant.localization.map_support import EvidenceOnMap, MapSupport
from sextant.localization.metric_pose import EvidenceWithPose, MetricErrors, MetricPoses
from sextant.localization.motion import ExponentialMotion, IdentityMotion
from sextant.localization.motion_density import Predicted
from sextant.localization.particle_filter import FilterState, ParticleFilter
from sextant.localization.recovery import BayesRestart, MetricProposal, NoRecovery
from sextant.localization.recovery.metric_proposal import log_prior
from sextant.localization.resampling import SystematicResampling

MAP = torch.zeros(6, 3, dtype=torch.float64)
MAP[:, 0] = 2.0 * torch.arange(6)
PRIOR, MOTION, HAZARD = MapPrior(MAP, 0.5, 0.15), ExponentialMotion((0.3, 0.2, 0.12)), 0.05
MOVED = torch.tensor([[1.0, 0.0, 0.1]], dtype=torch.float64)
#: the belief before the motion: at one of these
BEFORE = torch.tensor([[0.0, 0.0, 0.0], [0.3, 0.2, -0.1], [4.0, -0.3, 0.1]], dtype=torch.float64)
AT = torch.tensor([[1.3, 0.15, 0.12]], dtype=torch.float64)


#: runs that are pooled, so that a bias shows
RUNS = 8


def image(poses):
    """Two places of the map look like the image."""
    near = torch.exp(-0.5 * ((poses[..., 0] - 1.5) / 0.6) ** 2)
    far = 0.7 * torch.exp(-0.5 * ((poses[..., 0] - 8.0) / 0.6) ** 2)
    return (near + far + 0.02).log() - 2 * poses[..., 2] ** 2


def evidence(sigma, weighs, wrong=0.2, located=True, at=AT, runs=1):
    covariance = torch.diag(torch.tensor([sigma, sigma, sigma / 2], dtype=torch.float64)).square()
    errors = MetricErrors(1.0, 4.0, wrong, 100.0)
    measured = MetricPoses(at.expand(runs, 3), covariance.expand(runs, 3, 3), torch.tensor([located] * runs), errors)
    return EvidenceWithPose(Told([image] * runs, MAP), measured, weighs)


def grid():
    x = torch.arange(-2.0, 12.5, 0.125, dtype=torch.float64)
    y = torch.arange(-2.0, 2.0, 0.1, dtype=torch.float64)
    turn = torch.arange(-0.9, 1.0, 0.06, dtype=torch.float64)
    return torch.cartesian_prod(x, y, turn), 0.125 * 0.1 * 0.06


def step(restarts, told, support=None, motion=MOVED, particles=3000, share=0.4, runs=1):
    """The beliefs of some runs after one step together, the log of their evidence, and how many were drawn anew."""
    recovery = restarts if share is None else MetricProposal(restarts, share)
    found = ParticleFilter(MOTION, SystematicResampling(), recovery, PRIOR, ess_threshold=0.0, support=support)
    poses = BEFORE.repeat(particles // 3, 1).expand(runs, -1, 3)
    way = torch.full((runs,), math.inf, dtype=torch.float64)
    state, motion = (
        FilterState(Belief.uniform(poses), recovery.memory(runs), way),
        None if motion is None else motion.expand(runs, 3),
    )
    after, result = found.step(state, motion, told, None, generator())
    evidence = result.log_evidence
    weights = after.belief.log_weights + evidence[:, None]
    together = Belief.of(after.belief.poses.reshape(1, -1, 3), weights.reshape(1, -1))
    return together, float(evidence.exp().mean().log()), int(result.injected.sum())


def by_grid(hazard, told, support=None):
    """Mass of the posterior on a grid, its log evidence, and the cells."""
    cells, volume = grid()
    density = (1 - hazard) * Predicted(Belief.uniform(BEFORE[None]), MOTION, MOVED, support).log_density(
        cells[None]
    ).exp()
    if hazard:
        density = density + hazard * log_prior(PRIOR, cells[None]).exp()
    told = told if support is None else told.restricted(lambda each: EvidenceOnMap(each, support))
    joint = (density * told.log_likelihood(cells[None]).exp())[0] * volume
    return cells, joint / joint.sum(), float(joint.sum().log())


@pytest.mark.parametrize(
    ("weighs", "restarts", "support"),
    [
        (False, NoRecovery(), None),
        (True, NoRecovery(), MapSupport.of(MAP)),
        (False, BayesRestart(HAZARD, 0.2), MapSupport.of(MAP)),
        (True, BayesRestart(HAZARD, 0.2), None),
    ],
)
def test_the_posterior_is_that_of_bayes_rule_on_a_grid(weighs, restarts, support):
    told = evidence(0.25, weighs, runs=RUNS)
    belief, log_evidence, injected = step(restarts, told, support, particles=1800, runs=RUNS)
    hazard = restarts.hazard if isinstance(restarts, BayesRestart) else 0.0
    cells, mass, expected = by_grid(hazard, evidence(0.25, weighs), support)
    assert injected >= RUNS * 720
    assert log_evidence == pytest.approx(expected, abs=0.05)
    near, weights = belief.poses[0, :, 0] < 4.5, belief.weights[0]
    assert float(weights[near].sum()) == pytest.approx(float(mass[cells[:, 0] < 4.5].sum()), abs=0.02)
    for axis in range(3):  # moments about the near place
        mean = float((weights * belief.poses[0, :, axis])[near].sum() / weights[near].sum())
        some, share = cells[cells[:, 0] < 4.5, axis], mass[cells[:, 0] < 4.5]
        wanted = float((share * some).sum() / share.sum())
        spread = math.sqrt(float((share * (some - wanted) ** 2).sum() / share.sum()))
        found = math.sqrt(float((weights * (belief.poses[0, :, axis] - mean) ** 2)[near].sum() / weights[near].sum()))
        assert mean == pytest.approx(wanted, abs=0.06 * spread)
        assert found == pytest.approx(spread, rel=0.06)


def test_weights_without_the_density_of_the_proposal_fail_the_same_test():
    """The test above can fail: counted fully beside the particles, a share of 0.4 is too much evidence."""
    told = evidence(0.25, True)
    _, log_evidence, _ = step(NoRecovery(), told)
    _, _, expected = by_grid(0.3, told)
    assert abs(log_evidence - expected) > 0.1


def test_a_sharp_pose_needs_the_proposal_and_few_particles():
    """Of 300 particles none comes within the centimetre that the pose determines; those around it do."""
    told, errors = evidence(0.01, True, wrong=0.01), []
    for share in (None, 0.4):
        belief, _, _ = step(NoRecovery(), told, particles=300, share=share)
        errors.append(float(((belief.weights[0, :, None] * belief.poses[0]).sum(0) - AT[0])[:2].norm()))
    assert errors[1] < 0.01 < errors[0]


def test_a_wrong_pose_leaves_the_belief_where_it_is():
    at = torch.tensor([[11.0, 1.0, 0.5]], dtype=torch.float64)
    belief, _, _ = step(NoRecovery(), evidence(0.05, True, at=at), particles=1200)
    usual, _, _ = step(NoRecovery(), evidence(0.05, True, located=False), particles=1200)
    means = [(each.weights[0, :, None] * each.poses[0]).sum(0) for each in (belief, usual)]
    torch.testing.assert_close(*means, atol=0.08, rtol=0)


@pytest.mark.parametrize("told", [Told([image], MAP), evidence(0.2, True, located=False)], ids=["none", "not_located"])
def test_without_a_located_pose_restarts_are_as_they_were(told):
    plain = step(BayesRestart(HAZARD, 0.2), told, particles=3000, share=None)
    assert step(BayesRestart(HAZARD, 0.2), told, particles=3000)[1:] == plain[1:]


def test_before_the_first_motion_only_restarts_are_drawn_around_a_pose():
    """There the particles come from the start; the share of them alone must not be taken away."""
    told = evidence(0.25, True, runs=RUNS)
    plain = step(BayesRestart(HAZARD, 0.2), told, motion=None, share=None, runs=RUNS)
    mixed = step(BayesRestart(HAZARD, 0.2), told, motion=None, runs=RUNS)
    assert mixed[1] == pytest.approx(plain[1], abs=0.05)
    assert step(NoRecovery(), told, motion=None, runs=RUNS)[2] == 0


def test_a_motion_without_density_is_not_foreseen():
    before = Belief.uniform(BEFORE[None])
    for model in (IdentityMotion(), ExponentialMotion((0.1, 0.0, 0.1))):
        predicted = Predicted(before, model, MOVED)
        assert not predicted.known.any()
        assert (predicted.log_density(BEFORE[None]) == -math.inf).all()


def test_a_run_that_stands_takes_nothing_from_those_that_move():
    moves = ExponentialMotion((0.0, 0.0, 0.0), per_metre=(0.1, 0.1, 0.1))
    alone = Predicted(Belief.uniform(BEFORE[None]), moves, MOVED)
    both = Predicted(Belief.uniform(BEFORE.expand(2, -1, -1)), moves, torch.cat([MOVED, 0 * MOVED]))
    assert both.known.tolist() == [True, False]
    density = both.log_density(BEFORE.expand(2, -1, -1))
    assert torch.equal(density[:1], alone.log_density(BEFORE[None]))
    assert (density[1] == -math.inf).all()


def test_restarts_weighed_by_several_images_are_refused():
    with pytest.raises(UserError, match="window=10 weighs them by several images"):
        MetricProposal(BayesRestart(HAZARD, 0.2, window=10))
