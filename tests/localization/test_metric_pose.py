"""Located poses in the plane, how they err, and their evidence beside that of a descriptor."""

import math

import numpy as np
import pytest
import torch
from jaxtyping import TypeCheckError
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_t
from small_worlds import Told, generator

from sextant.errors import UserError
from sextant.geometry import level_camera_pose
from sextant.localization.belief import Belief
from sextant.localization.map_support import EvidenceOnMap, MapSupport
from sextant.localization.metric_pose import DrivePoses, EvidenceWithPose, MetricErrors, MetricPoses, planar_pose
from sextant.localization.motion import ExponentialMotion
from sextant.localization.motion_density import Predicted

COVARIANCE = torch.tensor([[0.04, 0.01, 0.0], [0.01, 0.09, 0.002], [0.0, 0.002, 0.01]], dtype=torch.float64)
ERRORS = MetricErrors(scale=1.5, dof=4.0, wrong=0.1, volume=500.0)


def test_the_covariance_in_the_plane_is_that_of_perturbed_cameras():
    rng = np.random.default_rng(0)
    camera = level_camera_pose(3.0, -2.0, 0.9, torch.tensor(2.0, dtype=torch.float64), 0.1, -0.05).numpy()
    root = rng.normal(size=(6, 6)) * 0.004
    pose, covariance = planar_pose(camera, root @ root.T)
    found = []
    for perturbed in rng.normal(size=(4000, 6)) @ root.T:
        moved = np.eye(4)
        moved[:3, :3], moved[:3, 3] = Rotation.from_rotvec(perturbed[3:]).as_matrix(), perturbed[:3]
        found.append(planar_pose(camera @ moved, root @ root.T)[0])
    assert pose == pytest.approx([3.0, -2.0, 2.0])
    scale = np.sqrt(np.outer(covariance.diagonal(), covariance.diagonal()))
    assert np.abs(np.cov(np.array(found).T) - covariance).max() < 0.06 * scale.max()


def test_the_density_is_students_with_headings_a_turn_apart_the_same():
    error = torch.randn(1, 50, 3, generator=generator(), dtype=torch.float64)
    expected = multivariate_t(np.zeros(3), 2.25 * COVARIANCE.numpy(), df=4.0)
    turned = [expected.pdf(error[0].numpy() + np.array([0, 0, turn])) for turn in (-2 * math.pi, 0, 2 * math.pi)]
    told = ERRORS.log_density(error, COVARIANCE[None]).exp()[0]
    assert told.numpy() == pytest.approx(sum(turned))
    again = error + torch.tensor([0.0, 0.0, 2 * math.pi], dtype=torch.float64)
    torch.testing.assert_close(ERRORS.log_density(again, COVARIANCE[None]).exp()[0], told)


def test_draws_have_the_density():
    """Shares of draws in boxes, against the density summed over their cells."""
    drawn = ERRORS.draw(COVARIANCE[None], 200_000, generator())[0]
    edges = torch.linspace(-0.6, 0.6, 41, dtype=torch.float64)
    cells = (edges[:-1] + edges[1:]) / 2
    grid = torch.cartesian_prod(cells, cells, cells)
    mass = ERRORS.log_density(grid[None], COVARIANCE[None]).exp()[0] * 0.03**3
    for side in (0.15, 0.3, 0.6):
        inside = float((drawn.abs() < side).all(1).double().mean())
        assert inside == pytest.approx(float(mass[(grid.abs() < side).all(1)].sum()), abs=0.01)


def test_a_pose_that_is_wrong_is_worth_the_share_of_wrong_poses():
    far = ERRORS.log_likelihood(torch.full((1, 1, 3), 50.0, dtype=torch.float64), COVARIANCE[None])
    assert float(far.exp()) == pytest.approx(0.1, rel=0.01)
    assert float(ERRORS.log_likelihood(torch.zeros(1, 1, 3, dtype=torch.float64), COVARIANCE[None])) > 5


def test_few_validation_images_fit_nothing():
    found = MetricErrors.fitted(np.zeros((3, 3)), np.tile(np.eye(3), (3, 1, 1)), 10.0)
    assert (found.scale, found.dof, found.wrong) == (1.0, 3.0, 0.1)


def test_the_limit_of_false_alarms_is_the_most_telling_one():
    """Poses of up to -20 are right here, and those above it wrong; a handful of right ones below -100 is too few."""
    rng = np.random.default_rng(0)
    alarms = np.concatenate([np.full(30, -120.0), np.full(60, -25.0), np.full(200, -2.0), np.full(50, np.inf)])
    errors = rng.normal(size=(340, 3)) * 0.02
    errors[90:290] = rng.uniform(-5, 5, (200, 3))
    found = MetricErrors.fitted(errors, np.tile(np.eye(3) * 4e-4, (340, 1, 1)), 1000.0, alarms)
    assert found.limit == -20.0
    assert found.scale == pytest.approx(1.0, abs=0.1)
    assert MetricErrors.fitted(errors, np.tile(np.eye(3) * 4e-4, (340, 1, 1)), 1000.0, alarms + 150).limit == -100.0


def test_off_the_map_the_descriptor_tells_nothing_but_the_located_pose_does():
    line = torch.zeros(10, 3, dtype=torch.float64)
    line[:, 0] = torch.arange(10)
    there = torch.tensor([[[4.0, 3.0, 0.0], [4.0, 5.0, 0.0]]], dtype=torch.float64)
    measured = MetricPoses(there[:, 0], COVARIANCE[None], torch.tensor([True]), ERRORS)
    plain = Told([lambda poses: -poses[..., 0]], line)
    on_map = EvidenceWithPose(plain, measured).restricted(lambda told: EvidenceOnMap(told, MapSupport.of(line)))
    change = on_map.log_likelihood(there) - measured.log_likelihood(there)
    assert float(change[0, 0]) == pytest.approx(float(change[0, 1]), abs=1e-6)
    assert float(measured.log_likelihood(there)[0, 0] - measured.log_likelihood(there)[0, 1]) > 3


def test_an_image_that_is_not_located_tells_nothing():
    poses = torch.zeros(1, 3, 3, dtype=torch.float64)
    measured = MetricPoses(poses[:, 0], COVARIANCE[None], torch.tensor([False]), ERRORS)
    plain = Told([lambda at: at[..., 0]], poses[0])
    torch.testing.assert_close(EvidenceWithPose(plain, measured).log_likelihood(poses), plain.log_likelihood(poses))


@pytest.mark.parametrize("known", [True, False])
def test_the_predicted_density_is_that_of_draws_of_the_motion(known):
    """Shares of draws in boxes, against the density summed over their cells; turns are large, so the volume counts."""
    model = ExponentialMotion((0.2, 0.15, 0.8), unknown=(0.3, 0.1, 0.9))
    motion = torch.tensor([[0.5, 0.1, 0.7]], dtype=torch.float64)
    motion = motion if known else motion * math.nan
    before = Belief.of(
        torch.tensor([[[0.0, 0.0, 0.3], [0.4, 0.2, -0.4]]], dtype=torch.float64),
        torch.tensor([[0.7, 0.3]], dtype=torch.float64).log(),
    )
    rows = torch.multinomial(before.weights[0], 400_000, replacement=True, generator=generator())
    drawn = model.sample(before.poses[:, rows], motion, generator(1))[0]
    middle = drawn[:, :2].mean(0)
    side = torch.linspace(-0.4, 0.4, 21, dtype=torch.float64)
    side = (side[:-1] + side[1:]) / 2
    turns = torch.linspace(0.0, 1.6, 41, dtype=torch.float64)
    grid = torch.cartesian_prod(middle[0] + side, middle[1] + side, (turns[:-1] + turns[1:]) / 2)
    mass = Predicted(before, model, motion).log_density(grid[None]).exp()[0] * 0.04**3
    offset = drawn - torch.cat([middle, middle.new_tensor([0.8])])
    inside = (offset.abs() < offset.new_tensor([0.4, 0.4, 0.8])).all(1)
    assert float(inside.double().mean()) == pytest.approx(float(mass.sum()), rel=0.02)
    ahead = inside & (drawn[:, 2] > 0.8)
    assert float(ahead.double().mean()) == pytest.approx(float(mass[grid[:, 2] > 0.8].sum()), rel=0.03)


@pytest.mark.parametrize(
    ("poses", "covariances", "located"), [((4, 2), (4, 3, 3), 4), ((4, 3), (3, 3, 3), 4), ((4, 3), (4, 3, 3), 3)]
)
def test_a_drive_has_a_pose_a_covariance_and_a_flag_for_each_frame(poses, covariances, located):
    with pytest.raises((UserError, TypeCheckError), match=r"must have|Type-check error"):
        DrivePoses(np.zeros(poses), np.zeros(covariances), np.ones(located, bool), ERRORS)


def test_located_poses_of_another_number_of_runs_are_refused():
    measured = MetricPoses(torch.zeros(1, 3).double(), COVARIANCE[None], torch.tensor([True]), ERRORS)
    with pytest.raises(UserError, match="poses of 2 runs for 1 located pose"):
        measured.log_likelihood(torch.zeros(2, 4, 3).double())
