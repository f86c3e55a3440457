"""Poses between the most alike images: weights, wrapped headings, steps without an image, and small maps."""

import math

import numpy as np
import pytest
import torch
from jaxtyping import TypeCheckError

from sextant.errors import UserError
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.interpolated_retrieval import interpolated
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation import KernelSum
from sextant.localization.observers import Camera
from sextant.localization.pose_kernel import PoseKernel

KERNEL = PoseKernel("rbf", (1.0, 1.0), 1.0, 1.0, 0.1)


def camera(poses, known, seen):
    where = DescriptorMap.of(torch.as_tensor(poses, dtype=torch.float64), torch.as_tensor(known, dtype=torch.float32))
    return Camera(KernelSum().fit(where, KERNEL), Likelihood(), np.asarray(seen, np.float32))


def track(of, frames, *, best, motion=None, seen=None, watch=None, radius=20.0):
    frames = np.asarray(frames)
    moved = np.zeros((*frames.shape, 3)) if motion is None else np.broadcast_to(motion, (*frames.shape, 3))
    there = np.ones(frames.shape, bool) if seen is None else np.asarray(seen)
    return interpolated(of, frames, np.array(moved, float), there, best=best, radius=radius, watch=watch)


@pytest.mark.parametrize("best", [1, 2, 3, 7, 30])
@pytest.mark.parametrize("seed", range(4))
def test_the_mean_is_that_of_plain_loops(seed, best):
    """K of one, some, all and more images than the map has; headings about the cut; similarities of both signs."""
    rng = np.random.default_rng(seed)
    poses = np.column_stack([rng.uniform(-3, 3, (7, 2)), math.pi + rng.uniform(-0.2, 0.2, 7)])
    known, query = rng.normal(size=(7, 5)).astype(np.float32), rng.normal(size=(2, 5)).astype(np.float32)
    found = track(camera(poses, known, query), [[0, 1]], best=best)
    mean = known.mean(0)
    for run in range(2):
        a, b = known - mean, query[run] - mean
        cosines = a @ b / np.linalg.norm(a, axis=1) / np.linalg.norm(b)
        chosen = np.argsort(-cosines)[:best]
        weights = np.maximum(cosines[chosen], 1e-6)
        weights /= weights.sum()
        expected = weights @ poses[chosen, :2]
        turned = weights @ poses[chosen, 2]
        assert found.pose[0, run, :2] == pytest.approx(expected, abs=1e-4)
        assert math.remainder(found.pose[0, run, 2] - turned, 2 * math.pi) == pytest.approx(0, abs=1e-4)
        assert found.ess[0, run] == pytest.approx(1 / (weights**2).sum(), rel=1e-4)
    assert (found.particles == min(best, 7)).all()


def test_headings_are_averaged_around_the_circle():
    poses = [[0.0, 0.0, math.radians(170)], [2.0, 0.0, math.radians(-170)], [9.0, 9.0, 0.0]]
    found = track(camera(poses, np.eye(3), [[1.0, 1.0, 0.0]]), [[0]], best=2)
    assert found.pose[0, 0, :2] == pytest.approx([1, 0])
    assert abs(found.pose[0, 0, 2]) == pytest.approx(math.pi)


@pytest.mark.parametrize("blind", [[1], [1, 2], [2, 3], [3]])
def test_steps_without_an_image_follow_the_odometry(blind):
    """The second, the last, and several steps in a row; a run beside that sees all is not affected."""
    poses = [[float(x), 0.0, 0.0] for x in range(6)]
    seen = np.ones((4, 2), bool)
    seen[blind, 0] = False
    frames = np.array([[0, 0], [1, 1], [2, 2], [3, 3]])
    found = track(camera(poses, np.eye(6), np.eye(6)), frames, best=1, motion=[1.0, 0.0, 0.0], seen=seen)
    assert found.pose[:, 0, 0] == pytest.approx([0, 1, 2, 3])
    assert found.pose[:, 1, 0] == pytest.approx([0, 1, 2, 3])


def test_without_image_and_odometry_the_last_pose_stays():
    poses = [[float(x), 0.0, 0.0] for x in range(6)]
    motion = np.array([[[0.0] * 3], [[np.nan] * 3], [[1.0, 0.0, 0.0]], [[np.nan] * 3]])
    seen, frames = [[True], [False], [False], [True]], [[2], [3], [4], [5]]
    found = track(camera(poses, np.eye(6), np.eye(6)), frames, best=1, motion=motion, seen=seen)
    assert found.pose[:, 0, 0] == pytest.approx([2, 2, 3, 5])


def test_before_the_first_image_the_pose_is_the_middle_of_the_map_and_a_jump_is_forgotten_at_once():
    poses = [[float(x), 0.0, 0.0] for x in range(5)]
    found = track(camera(poses, np.eye(5), np.eye(5)), [[0], [1], [4]], best=5, seen=[[False], [False], [True]])
    assert found.pose[:2, 0, 0] == pytest.approx([2, 2])
    jumped = track(camera(poses, np.eye(5), np.eye(5)), [[0], [4], [0]], best=1)
    assert jumped.pose[:, 0, 0] == pytest.approx([0, 4, 0])


def test_images_of_another_place_do_not_move_the_mean():
    """Two of three agree; the third is far away, though most alike."""
    poses = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [50.0, 0.0, 0.0], [0.0, 90.0, 0.0]]
    found = track(camera(poses, np.eye(4), [[1.0, 1.0, 1.05, 0.0]]), [[0]], best=3, radius=2.0)
    assert found.pose[0, 0] == pytest.approx([0.5, 0, 0])
    assert 0.5 < found.mass[0, 0] < 0.67


def test_an_image_like_no_other_still_has_an_answer():
    poses = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    beliefs = []
    known = [[1.0, 0.0], [-1.0, 0.0], [0.0, 0.0]]
    alike = camera(poses, known, [[0.0, 1.0], [0.0, 0.0]])  # at right angles, and of no length
    found = track(alike, [[0, 1]], best=3, watch=lambda step, belief: beliefs.append(belief))
    assert found.pose[0, :, 0] == pytest.approx([1, 1])
    assert torch.isfinite(beliefs[0].log_weights).all()


@pytest.mark.parametrize(("motion", "seen"), [((1, 2, 3), (1, 1)), ((1, 1, 3), (1, 2)), ((1, 3), (1, 1))])
def test_motions_and_flags_are_those_of_the_frames(motion, seen):
    drive, frames = camera([[float(x), 0.0, 0.0] for x in range(3)], np.eye(3), np.eye(3)), np.array([[0]])
    with pytest.raises((UserError, TypeCheckError), match=r"(motion|seen) has .* must have|Type-check error"):
        interpolated(drive, frames, np.zeros(motion), np.ones(seen, bool), best=1, radius=1.0)
