"""Smoothing against what is known in closed form, and what it does on drives."""

import math

import numpy as np
import pytest
import torch
from jaxtyping import TypeCheckError

from sextant.errors import UserError
from sextant.geometry.planar import se2_compose
from sextant.localization.belief import Belief
from sextant.localization.motion import ExponentialMotion, IdentityMotion, OdometryMotion
from sextant.localization.smoothing import smoothed

STEP, SEEN = 0.3, 0.5  # standard deviations of a motion along and of what is seen
WALK = ExponentialMotion(per_step=(STEP, 1e-6, 1e-6))


def filtered(seen, particles, seed):
    """Beliefs of a robot that moves one metre along x at a time and sees x with noise, from x = 0."""
    draws = torch.Generator().manual_seed(seed)
    poses = torch.zeros(1, particles, 3, dtype=torch.float64)
    poses[..., 0] = torch.randn(1, particles, generator=draws, dtype=torch.float64)
    beliefs, motion = [], torch.tensor([[1.0, 0.0, 0.0]], dtype=torch.float64)
    for step, value in enumerate(seen):
        if step:
            drawn = torch.multinomial(beliefs[-1].weights[0], particles, replacement=True, generator=draws)
            poses = WALK.sample(beliefs[-1].poses[:, drawn], motion, draws)
        beliefs.append(Belief.of(poses, -0.5 * ((poses[..., 0] - value) / SEEN) ** 2))
    return beliefs, [motion] * (len(seen) - 1)


def kalman_smoother(seen):
    """Means and variances of the same model: Rauch, Tung & Striebel 1965."""
    mean, variance, forward = 0.0, 1.0, []
    for step, value in enumerate(seen):
        if step:
            mean, variance = mean + 1.0, variance + STEP**2
        gain = variance / (variance + SEEN**2)
        mean, variance = mean + gain * (value - mean), (1 - gain) * variance
        forward.append((mean, variance))
    found = [forward[-1]]
    for mean, variance in reversed(forward[:-1]):
        gain = variance / (variance + STEP**2)
        after_mean, after = found[-1]
        found.append((mean + gain * (after_mean - mean - 1.0), variance + gain**2 * (after - variance - STEP**2)))
    return np.array(found[::-1])


def moments(beliefs):
    means = np.array([float((b.weights * b.poses[..., 0]).sum()) for b in beliefs])
    second = np.array([float((b.weights * b.poses[..., 0] ** 2).sum()) for b in beliefs])
    return means, second - means**2


@pytest.mark.slow
def test_it_is_the_kalman_smoother_where_there_is_one():
    seen = [0.4, 1.1, 1.6, 3.5, 4.2, 5.1]
    beliefs, motions = filtered(seen, 2000, seed=0)
    means, variances = moments(smoothed(beliefs, motions, WALK, torch.Generator().manual_seed(1)))
    exact = kalman_smoother(seen)
    np.testing.assert_allclose(means, exact[:, 0], atol=0.03)
    np.testing.assert_allclose(variances, exact[:, 1], rtol=0.15)


@pytest.mark.slow
def test_the_past_is_known_better_and_the_last_belief_is_as_it_was():
    errors = []
    for seed in range(20):
        draws = np.random.default_rng(seed)
        truth = np.cumsum([draws.standard_normal(), *(1 + STEP * draws.standard_normal(9))])
        beliefs, motions = filtered(truth + SEEN * draws.standard_normal(10), 200, seed)
        found = smoothed(beliefs, motions, WALK, torch.Generator().manual_seed(seed))
        assert found[-1] is beliefs[-1]
        errors.append([((moments(each)[0] - truth)[:-1] ** 2).mean() for each in (beliefs, found)])
    before, after = np.sqrt(np.mean(errors, 0))
    assert after < 0.9 * before  # of an endless drive, by the equations of both: 0.80


@pytest.mark.parametrize(
    "model", [OdometryMotion(), ExponentialMotion(), IdentityMotion()], ids=lambda m: type(m).__name__
)
def test_one_of_two_places_is_ruled_out_afterwards(model):
    """Two corridors look alike until the robot sees the end of one of them; headings differ by more than pi."""
    motion = torch.tensor([[0.0 if isinstance(model, IdentityMotion) else 1.0, 0.0, 0.2]], dtype=torch.float64)
    if isinstance(model, IdentityMotion):
        motion = torch.zeros_like(motion)
    draws = torch.Generator().manual_seed(0)
    places = torch.tensor([[0.0, 0.0, 3.1], [40.0, 0.0, -3.1]], dtype=torch.float64).repeat_interleave(100, 0)[None]
    first = Belief.uniform(places)
    second = Belief.uniform(model.sample(first.poses, motion, draws))
    ruled_out = Belief.of(second.poses, torch.where(second.poses[..., 0] > 20, 0.0, -torch.inf))
    weights = smoothed([first, ruled_out], [motion], model, draws)[0].weights[0]
    assert float(weights[100:].sum()) == pytest.approx(1.0, abs=1e-6)


def test_a_restart_elsewhere_says_nothing_of_the_pose_before():
    draws = torch.Generator().manual_seed(0)
    first = Belief.of(
        torch.tensor([[[0.0, 0, 0], [5.0, 0, 0]]], dtype=torch.float64), torch.tensor([[0.7, 0.3]]).log().double()
    )
    restarted = Belief.uniform(torch.tensor([[[900.0, 70.0, 1.0]]], dtype=torch.float64))
    motion = torch.tensor([[1.0, 0, 0]], dtype=torch.float64)
    found = smoothed([first, restarted], [motion], OdometryMotion(), draws)[0]
    np.testing.assert_allclose(found.weights, first.weights, atol=1e-6)


def test_an_unknown_motion_reaches_as_far_as_the_model_says():
    draws = torch.Generator().manual_seed(0)
    model = OdometryMotion(unknown=(2.0, 2.0, 1.0))
    start = torch.zeros(1, 400, 3, dtype=torch.float64)
    start[..., 0] = torch.linspace(-10, 10, 400)
    after = Belief.uniform(torch.zeros(1, 1, 3, dtype=torch.float64))
    lost = torch.full((1, 3), math.nan, dtype=torch.float64)
    weights = smoothed([Belief.uniform(start), after], [lost], model, draws)[0].weights[0]
    spread = float((weights * start[0, :, 0] ** 2).sum().sqrt())
    assert spread == pytest.approx(2.0, rel=0.1)


def test_runs_are_smoothed_each_for_itself():
    beliefs, motions = filtered([0.1, 1.2, 2.0], 50, seed=3)
    twice = [Belief(b.poses.repeat(2, 1, 1), b.log_weights.repeat(2, 1)) for b in beliefs]
    found = smoothed(twice, [m.repeat(2, 1) for m in motions], WALK, torch.Generator().manual_seed(1))
    assert found[0].log_weights.shape == (2, 50)
    np.testing.assert_allclose(found[0].weights[0], found[0].weights[1], atol=0.02)


def test_it_says_how_far_it_is():
    beliefs, motions = filtered([0.0, 1.0, 2.0], 5, seed=0)
    steps = []
    smoothed(beliefs, motions, WALK, torch.Generator(), progress=lambda done, total: steps.append((done, total)))
    assert steps == [(2, 3), (3, 3)]


def test_the_number_of_motions_is_checked():
    beliefs, motions = filtered([0.0, 1.0, 2.0], 5, seed=0)
    with pytest.raises(ValueError, match="one motion fewer than beliefs; got 1 motions and 3 beliefs"):
        smoothed(beliefs, motions[:1], WALK, torch.Generator())
    with pytest.raises((UserError, TypeCheckError), match=r"motion has .* must have \(1, 3\)|Type-check error"):
        smoothed(beliefs, [motion.repeat(2, 1) for motion in motions], WALK, torch.Generator())


def test_it_does_not_depend_on_where_the_map_is():
    beliefs, motions = filtered([0.1, 1.2, 2.0], 80, seed=5)
    here = torch.tensor([[[3000.0, -2000.0, 2.5]]], dtype=torch.float64)
    moved = [Belief(se2_compose(here.expand_as(b.poses), b.poses), b.log_weights) for b in beliefs]
    one, other = (smoothed(each, motions, WALK, torch.Generator().manual_seed(1)) for each in (beliefs, moved))
    np.testing.assert_allclose(one[0].weights, other[0].weights, atol=1e-6)
