"""Every motion model against what its equations say, and against drives with noise drawn one number at a time."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from small_worlds import generator

from sextant.geometry import se2_between, se2_compose, se2_exp, se2_log, wrap_angle
from sextant.localization.motion import ExponentialMotion, IdentityMotion, OdometryMotion, PacedMotion

NOISY = [
    ExponentialMotion((0.05, 0.02, 0.01), (0.01, 0.002, 0.001), (0.02, 0.01, 0.01)),
    OdometryMotion((0.05, 0.01, 0.02, 0.03)),
]
NOISELESS = [ExponentialMotion((0.0, 0.0, 0.0)), OdometryMotion((0.0, 0.0, 0.0, 0.0))]
motions = st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(-3, 3))
tiny = st.tuples(st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3))


def start(runs=1, particles=5, seed=0):
    poses = 10 * torch.randn(runs, particles, 3, dtype=torch.float64, generator=generator(seed))
    return torch.cat([poses[..., :2], wrap_angle(poses[..., 2:])], dim=2)


def assert_same_pose(found, expected):
    assert float((found - expected)[..., :2].abs().max()) < 1e-9
    assert float(wrap_angle(found - expected)[..., 2].abs().max()) < 1e-9


@pytest.mark.parametrize("model", NOISELESS, ids=["exponential", "odometry"])
@given(motion=motions | tiny)
def test_without_noise_a_robot_does_what_odometry_says(model, motion):
    motion, poses = torch.tensor([motion], dtype=torch.float64), start()
    assert_same_pose(model.sample(poses, motion, generator()), se2_compose(poses, motion[:, None]))


@pytest.mark.parametrize("model", NOISY, ids=["exponential", "odometry"])
@given(motion=motions)
def test_motions_do_not_depend_on_where_the_robot_is(model, motion):
    motion, poses = torch.tensor([motion], dtype=torch.float64), start()
    moved = model.sample(poses, motion, generator(1))
    from_origin = model.sample(torch.zeros_like(poses), motion, generator(1))
    assert_same_pose(se2_between(poses, moved), from_origin)


@pytest.mark.parametrize("model", [*NOISY, IdentityMotion()], ids=["exponential", "odometry", "identity"])
def test_an_unknown_motion_diffuses_one_run_and_leaves_the_others(model):
    poses = start(runs=3, particles=40_000)
    motion = torch.tensor([[1.0, 0.0, 0.2], [math.nan, 0.0, 0.2], [0.5, 0.1, 0.0]], dtype=torch.float64)
    moved = model.sample(poses, motion, generator(1))
    known = model.sample(poses, torch.where(motion.isnan(), 7.0, motion), generator(1))
    assert torch.equal(moved[[0, 2]], known[[0, 2]])
    twist = se2_log(se2_between(poses[1], moved[1]))
    assert float(twist.mean(0).abs().max()) < 0.02
    torch.testing.assert_close(twist.std(0), torch.tensor(model.if_unknown()).double(), rtol=0.02, atol=1e-9)


def test_a_train_whose_odometry_is_lost_stays_on_its_line():
    lost = torch.full((1, 3), math.nan, dtype=torch.float64)
    moved = ExponentialMotion((0.05, 0.0, 0.0)).sample(torch.zeros(1, 5000, 3).double(), lost, generator())
    assert float(moved[..., 0].std()) == pytest.approx(1.0, rel=0.05)
    assert float(moved[..., 1:].abs().max()) == 0
    assert ExponentialMotion(unknown=(3.0, 2.0, 1.0)).if_unknown() == (3.0, 2.0, 1.0)


def test_exponential_noise_grows_with_the_way_and_the_turn():
    model = ExponentialMotion((0.05, 0.02, 0.01), (0.01, 0.002, 0.001), (0.02, 0.01, 0.01))
    motion = torch.tensor([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [0.0, 0.0, -2.0]], dtype=torch.float64)
    poses = start(runs=3, particles=60_000)
    moved = model.sample(poses, motion, generator())
    noise = se2_log(se2_between(se2_compose(poses, motion[:, None]), moved))
    variance = torch.tensor(
        [
            [0.0025, 0.0004, 0.0001],
            [0.0025 + 0.05, 0.0004 + 0.01, 0.0001 + 0.005],
            [0.0025 + 0.04, 0.0004 + 0.02, 0.0001 + 0.02],
        ],
        dtype=torch.float64,
    )
    torch.testing.assert_close(noise.var(1), variance, rtol=0.03, atol=0)
    assert float(noise.mean(1).abs().max()) < 0.005


def table_5_6(motion, alphas, noise):
    """Thrun, Burgard & Fox, table 5.6, line by line for one particle at the origin."""
    x, y, theta = motion
    rot1 = math.atan2(y, x)
    trans = math.hypot(x, y)
    rot2 = theta - rot1
    a1, a2, a3, a4 = alphas
    rot1_hat = rot1 + noise[0] * math.sqrt(a1 * rot1**2 + a2 * trans**2)
    trans_hat = trans + noise[1] * math.sqrt(a3 * trans**2 + a4 * (rot1**2 + rot2**2))
    rot2_hat = rot2 + noise[2] * math.sqrt(a1 * rot2**2 + a2 * trans**2)
    return [trans_hat * math.cos(rot1_hat), trans_hat * math.sin(rot1_hat), rot1_hat + rot2_hat]


@given(st.floats(0.05, 2), st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.integers(0, 1000))
def test_a_drive_forward_is_the_table_of_the_book(way, direction, turn, seed):
    alphas = (0.1, 0.02, 0.05, 0.03)
    motion = [way * math.cos(direction), way * math.sin(direction), turn]
    noise = torch.randn(1, 4, 3, dtype=torch.float64, generator=generator(seed))
    found = OdometryMotion(alphas).increments(torch.tensor([motion], dtype=torch.float64), noise)
    expected = [table_5_6(motion, alphas, one) for one in noise[0].tolist()]
    assert_same_pose(found[0], torch.tensor(expected, dtype=torch.float64))


@given(st.floats(0.05, 2), st.floats(-1.5, 1.5), st.floats(-1.0, 1.0), st.integers(0, 1000))
def test_a_drive_backward_is_a_drive_forward_seen_from_behind(way, direction, turn, seed):
    """With the same noise, but for the sign of the way's, both end half a turn about the start from each other."""
    motion = torch.tensor([[way * math.cos(direction), way * math.sin(direction), turn]], dtype=torch.float64)
    behind = motion * torch.tensor([-1.0, -1.0, 1.0]).double()
    noise = torch.randn(1, 4, 3, dtype=torch.float64, generator=generator(seed))
    model = OdometryMotion((0.1, 0.02, 0.05, 0.03))
    mirrored = model.increments(behind, noise * torch.tensor([1.0, -1.0, 1.0]).double())
    forward = model.increments(motion, noise)
    assert_same_pose(mirrored * torch.tensor([-1.0, -1.0, 1.0]).double(), forward)


@given(st.floats(-math.pi, math.pi))
def test_a_robot_that_stands_does_not_turn_by_the_direction_of_its_noise(direction):
    motion = torch.tensor([[1e-4 * math.cos(direction), 1e-4 * math.sin(direction), 0.0]], dtype=torch.float64)
    moved = OdometryMotion().sample(torch.zeros(1, 1000, 3, dtype=torch.float64), motion, generator())
    assert float(moved.abs().max()) < 1e-3


def test_a_robot_that_turns_on_the_spot_has_the_noise_of_its_turn():
    motion = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
    moved = OdometryMotion((0.04, 0.0, 0.0, 0.01)).sample(start(particles=50_000) * 0, motion, generator())
    assert float(moved[..., 2].std()) == pytest.approx(0.2, rel=0.02)
    assert float(moved[..., :2].norm(dim=2).square().mean().sqrt()) == pytest.approx(0.1, rel=0.02)


@given(motion=motions)
def test_identity_leaves_every_pose(motion):
    poses = start()
    assert_same_pose(IdentityMotion().sample(poses, torch.tensor([motion], dtype=torch.float64), generator()), poses)


def test_the_same_generator_gives_the_same_motion():
    poses, motion = start(particles=20), torch.tensor([[1.0, 0.0, 0.1]], dtype=torch.float64)
    for model in NOISY:
        first, again, other = (model.sample(poses, motion, generator(seed)) for seed in (1, 1, 2))
        assert torch.equal(first, again)
        assert not torch.equal(first, other)


def test_exponential_motion_composes_the_motion_before_its_noise():
    noise = torch.randn(1, 3, 3, dtype=torch.float64, generator=generator())
    motion = torch.tensor([[1.0, 0.2, 0.3]], dtype=torch.float64)
    found = ExponentialMotion((0.1, 0.2, 0.3)).increments(motion, noise)
    expected = se2_compose(motion[:, None], se2_exp(noise * torch.tensor([0.1, 0.2, 0.3]).double()))
    torch.testing.assert_close(found, expected)


def test_where_motion_is_unknown_most_particles_keep_the_pace_and_some_spread_or_turn():
    measured = ExponentialMotion((0.05, 0.02, 0.01), unknown=(1.0, 0.1, 0.05))
    poses, unknown = torch.zeros(1, 120_000, 3, dtype=torch.float64), torch.full((1, 3), math.nan, dtype=torch.float64)
    departure = torch.tensor([0.6], dtype=torch.float64)
    for pace, one_in, about in ((5.0, 5, 0.6), (None, 2, 1.0)):
        paced = torch.tensor([math.nan if pace is None else pace], dtype=torch.float64)
        moves = PacedMotion(measured, paced, departure, torch.zeros_like(paced))
        twist = se2_log(moves.sample(poses, unknown, generator(1)))[0]
        number = torch.arange(120_000)
        further = number % one_in == one_in - 1
        turning = (number % 5 == 2) & ~further
        for some, along, spread in (
            (further, 0.0, (4.0, 0.1, 0.05)),
            (turning, pace or 0.0, (about, 0.1, 0.2)),
            (~(further | turning), pace or 0.0, (about, 0.1, 0.05)),
        ):
            assert twist[some].mean(0).tolist() == pytest.approx([along, 0, 0], abs=0.1)
            assert twist[some].std(0).tolist() == pytest.approx(spread, rel=0.05)


def test_a_pace_changes_nothing_of_a_motion_that_is_known():
    poses, motion = start(), torch.tensor([[1.0, 0.1, 0.2]], dtype=torch.float64)
    pace, departure, still = torch.tensor([[5.0], [0.6], [0.9]], dtype=torch.float64)
    paced = PacedMotion(NOISY[0], pace, departure, still).sample(poses, motion, generator(1))
    assert torch.equal(paced, NOISY[0].sample(poses, motion, generator(1)))


@pytest.mark.parametrize("still", [0.0, 0.3, 1.0])
def test_as_many_particles_stand_as_the_robot_probably_does(still):
    measured = ExponentialMotion((0.05, 0.02, 0.01), unknown=(0.01, 0.001, 0.001))
    poses, unknown = torch.zeros(2, 10_000, 3, dtype=torch.float64), torch.full((2, 3), math.nan, dtype=torch.float64)
    pace, departure, shares = torch.tensor([[5.0, 5.0], [1.0, 1.0], [still, 0.0]], dtype=torch.float64)
    moved = PacedMotion(measured, pace, departure, shares).sample(poses, unknown, generator(1))[..., 0]
    kept = (moved > 4.0).double().mean(1)
    assert kept.tolist() == pytest.approx([0.8 * (1 - still), 0.8], abs=0.001)  # every fifth breaks the pace
    assert (moved == 0).double().mean(1).tolist() == pytest.approx([still, 0.0], abs=0.001)
