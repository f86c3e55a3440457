import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from localization.moments import mean_over_all
from small_worlds import generator

from sextant.geometry import se2_compose, wrap_angle
from sextant.localization.belief import Belief
from sextant.localization.estimate import estimate


def cloud(centre, sigma, count=2000, seed=0):
    noise = torch.randn(count, 3, dtype=torch.float64, generator=generator(seed))
    poses = torch.tensor(centre, dtype=torch.float64) + noise * torch.tensor(sigma, dtype=torch.float64)
    return torch.cat([poses[:, :2], wrap_angle(poses[:, 2:])], dim=1)


def belief_of(*clouds, shares=None):
    shares = shares or [1 / len(clouds)] * len(clouds)
    log_weights = torch.cat([torch.full((len(c),), share / len(c)) for c, share in zip(clouds, shares, strict=True)])
    return Belief.of(torch.cat(clouds)[None], log_weights.double().log()[None])


@given(st.floats(-40, 40), st.floats(-40, 40), st.floats(-math.pi, math.pi))
def test_one_cloud_is_told_by_its_moments(x, y, heading):
    """Anywhere, at any heading, on the edges of boxes and over the seam of the circle."""
    sigma = (0.2, 0.1, 0.05)
    found = estimate(belief_of(cloud((x, y, heading), sigma)), 2.0)
    error = found.pose[0] - torch.tensor([x, y, heading]).double()
    error[2] = wrap_angle(error[2])
    assert bool((error.abs() < torch.tensor([0.02, 0.01, 0.005])).all())
    torch.testing.assert_close(found.covariance[0], torch.diag(torch.tensor(sigma).double() ** 2), rtol=0.1, atol=0.003)
    assert float(found.mass[0]) > 0.999
    assert found.modes.tolist() == [1]
    assert -math.pi <= float(found.pose[0, 2]) < math.pi


@given(st.floats(-math.pi, math.pi), st.floats(-3, 3), st.floats(-3, 3))
def test_a_map_that_is_moved_moves_the_estimate(turn, x, y):
    """The mean over all moves with the frame; the covariance turns with it."""
    poses = cloud((5.0, 1.0, 3.0), (0.5, 0.2, 0.1), count=300)[None]
    moved = se2_compose(torch.tensor([x, y, turn]).double(), poses)
    pose, covariance = mean_over_all(Belief.uniform(poses))
    moved_pose, moved_covariance = mean_over_all(Belief.uniform(moved))
    expected = se2_compose(torch.tensor([x, y, turn]).double(), pose)
    assert float((expected - moved_pose)[0, :2].abs().max()) < 1e-9
    assert abs(float(wrap_angle(expected - moved_pose)[0, 2])) < 1e-9
    rotation = torch.eye(3, dtype=torch.float64)
    rotation[:2, :2] = torch.tensor([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    torch.testing.assert_close(moved_covariance[0], rotation @ covariance[0] @ rotation.T, rtol=1e-6, atol=1e-9)


def test_means_of_headings_wrap():
    poses = torch.zeros(1, 2, 3, dtype=torch.float64)
    poses[0, :, 2] = torch.tensor([math.pi - 0.1, -math.pi + 0.1], dtype=torch.float64)
    belief = Belief.uniform(poses)
    for pose, covariance in (mean_over_all(belief), (estimate(belief, 1.0).pose, estimate(belief, 1.0).covariance)):
        assert abs(float(pose[0, 2])) == pytest.approx(math.pi)
        assert float(covariance[0, 2, 2]) == pytest.approx(0.01)


def test_the_heavier_of_two_places_is_chosen_and_both_are_counted():
    here, there = cloud((0, 0, 0), (0.3, 0.3, 0.05)), cloud((30, 5, 1), (0.3, 0.3, 0.05), seed=1)
    for shares, near in (((0.6, 0.4), 0.0), ((0.4, 0.6), 30.0)):
        found = estimate(belief_of(here, there, shares=shares), 2.0)
        assert float(found.pose[0, 0]) == pytest.approx(near, abs=0.05)
        assert float(found.mass[0]) == pytest.approx(0.6, abs=0.01)
        assert found.modes.tolist() == [2]
    assert float(mean_over_all(belief_of(here, there))[0][0, 0]) == pytest.approx(15, abs=0.1)


def test_the_covariance_is_of_the_belief_and_not_of_the_place_that_is_told():
    """About 0 with 0.6 of the weight there and 0.4 at 30, 5: 0.4 * 30² and 0.4 * 5² are the expected squared errors."""
    here, there = cloud((0, 0, 0), (0.3, 0.3, 0.05)), cloud((30, 5, 0), (0.3, 0.3, 0.05), seed=1)
    found = estimate(belief_of(here, there, shares=(0.6, 0.4)), 2.0)
    assert float(found.covariance[0, 0, 0]) == pytest.approx(0.4 * 30**2, rel=0.05)
    assert float(found.covariance[0, 1, 1]) == pytest.approx(0.4 * 5**2, rel=0.05)
    assert float(found.covariance[0, 2, 2]) == pytest.approx(0.05**2, rel=0.1)


def test_a_wide_cloud_has_its_covariance_whatever_the_radius():
    wide = belief_of(cloud((3, 1, 0), (5.0, 3.0, 0.05)))
    covariance = estimate(wide, 1.0).covariance[0]
    assert float(covariance[0, 0].sqrt()) == pytest.approx(5, rel=0.25)  # about the pose told, somewhere in the middle
    assert float(covariance[1, 1].sqrt()) == pytest.approx(3, rel=0.25)


def test_a_hundredth_all_over_the_map_is_not_counted():
    """Which a recovery puts there; nor does another run of the batch change what is told of this one."""
    here, anywhere = cloud((0, 0, 0), (0.3, 0.3, 0.05)), cloud((0, 0, 0), (100.0, 100.0, 1.0), seed=1)
    sure, torn = belief_of(here, anywhere, shares=(0.995, 0.005)), belief_of(here, anywhere, shares=(0.5, 0.5))
    alone = estimate(sure, 2.0)
    assert float(alone.covariance[0, 0, 0].sqrt()) == pytest.approx(0.3, rel=0.05)
    together = estimate(
        Belief(torch.cat([sure.poses, torn.poses]), torch.cat([sure.log_weights, torn.log_weights])), 2.0
    )
    torch.testing.assert_close(together.covariance[0], alone.covariance[0], rtol=0, atol=0)
    assert float(together.covariance[1, 0, 0].sqrt()) > 50


def test_two_headings_at_one_place_are_two_modes():
    east, west = cloud((0, 0, 0), (0.1, 0.1, 0.05)), cloud((0, 0, math.pi), (0.1, 0.1, 0.05), seed=1)
    found = estimate(belief_of(east, west, shares=[0.7, 0.3]), 2.0)
    assert found.modes.tolist() == [2]
    assert abs(float(found.pose[0, 2])) < 0.02
    assert float(found.mass[0]) == pytest.approx(0.7, abs=0.01)


def test_a_mode_shared_by_eight_boxes_counts_and_a_lighter_one_does_not():
    main = cloud((1.0, 1.0, 0.25), (0.1, 0.1, 0.05))
    corner = cloud((40.0, 40.0, 0.0), (0.2, 0.2, 0.1), seed=1)
    assert estimate(belief_of(main, corner, shares=[0.94, 0.06]), 2.0).modes.tolist() == [2]
    assert estimate(belief_of(main, corner, shares=[0.96, 0.04]), 2.0).modes.tolist() == [1]


def test_a_long_street_of_neighbours_is_one_mode():
    street = torch.zeros(60, 3, dtype=torch.float64)
    street[:, 0] = torch.arange(60)
    assert estimate(Belief.uniform(street[None]), 1.0).modes.tolist() == [1]
    assert estimate(Belief.uniform((street * 2.5)[None]), 1.0).modes.tolist() == [0]


def test_a_place_on_the_corner_of_eight_boxes_outweighs_a_heavier_box():
    corner = cloud((4.0, 4.0, 0.0), (0.5, 0.5, 0.1))
    single = cloud((21.0, 21.0, 0.25), (0.05, 0.05, 0.02), seed=1)
    found = estimate(belief_of(corner, single, shares=[0.75, 0.25]), 2.0)
    assert float(found.pose[0, 0]) == pytest.approx(4.0, abs=0.1)
    assert found.modes.tolist() == [2]


def test_a_belief_all_over_the_map_has_no_mode():
    poses = torch.rand(1, 4000, 3, dtype=torch.float64, generator=generator()) * 200
    poses[..., 2] = wrap_angle(poses[..., 2])
    found = estimate(Belief.uniform(poses), 2.0)
    assert found.modes.tolist() == [0]
    assert float(found.mass[0]) < 0.02
    assert bool(found.pose.isfinite().all())


def test_a_ring_with_nobody_in_its_middle_still_gives_a_pose():
    angle = torch.arange(12, dtype=torch.float64) * (math.pi / 6)
    poses = torch.stack([1.2 * angle.cos() + 0.001, 1.2 * angle.sin(), 0 * angle], dim=1)[None]
    found = estimate(Belief.uniform(poses), 1.0)
    assert bool(found.pose.isfinite().all())
    assert bool(found.covariance.isfinite().all())
    assert float(found.mass[0]) > 0


@given(st.integers(1, 6), st.integers(0, 2**16))
def test_estimates_are_finite_and_covariances_positive(runs, seed):
    rng = generator(seed)
    poses = torch.randn(runs, 17, 3, dtype=torch.float64, generator=rng) * 3
    log_weights = 5 * torch.randn(runs, 17, dtype=torch.float64, generator=rng)
    log_weights[:, ::4] = -math.inf  # such particles must not draw the estimate to a box where nobody is
    belief = Belief.of(poses, log_weights)
    found = estimate(belief, 1.5)
    alone = [estimate(Belief(poses[run : run + 1], belief.log_weights[run : run + 1]), 1.5) for run in range(runs)]
    torch.testing.assert_close(found.pose, torch.cat([one.pose for one in alone]))
    assert torch.equal(found.modes, torch.cat([one.modes for one in alone]))
    assert bool((torch.linalg.eigvalsh(found.covariance) > -1e-12).all())
    assert bool(((found.mass > 0) & (found.mass <= 1 + 1e-9)).all())


def test_one_particle_is_the_estimate():
    pose = torch.tensor([[[3.0, -4.0, 2.5]]], dtype=torch.float64)
    found = estimate(Belief.uniform(pose), 1.0)
    torch.testing.assert_close(found.pose, pose[0])
    assert float(found.covariance.abs().max()) == 0
    assert found.modes.tolist() == [1]
    assert float(found.mass[0]) == pytest.approx(1)


@pytest.mark.parametrize(("radius", "heading"), [(0.0, 1.0), (1.0, -1.0), (math.nan, 1.0)])
def test_radii_must_be_above_zero(radius, heading):
    with pytest.raises(ValueError, match="must be above 0"):
        estimate(Belief.uniform(torch.zeros(1, 1, 3).double()), radius, heading)
