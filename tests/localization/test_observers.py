"""What a sensor tells at frames of a drive."""

import numpy as np
import pytest
import torch
from localization.observation.smooth_map import KERNEL, descriptors_at, poses_in_room, smooth_map

from sextant.localization.likelihood import Likelihood
from sextant.localization.observation import ExactGP
from sextant.localization.observers import Camera, Laser


@pytest.fixture(scope="module")
def model():
    return ExactGP().fit(smooth_map(120, 6), KERNEL)


def test_a_camera_tells_the_evidence_of_its_frames(model):
    poses = poses_in_room(20, seed=3)
    seen = descriptors_at(poses, 6).numpy()
    likelihood = Likelihood(tempering=0.5, appearance_variance=0.1)
    frames = np.array([7, 0, 7, 19])
    evidence = Camera(model, likelihood, seen).observe(frames)
    where = poses_in_room(4 * 5, seed=8).view(4, 5, 3)
    direct = model.observe(torch.from_numpy(seen[frames]), likelihood)
    torch.testing.assert_close(evidence.log_likelihood(where), direct.log_likelihood(where))
    torch.testing.assert_close(evidence.over_map(), direct.over_map())
    assert evidence.over_map().shape == (4, 120)
    torch.testing.assert_close(evidence.over_map()[0], evidence.over_map()[2])


def test_a_camera_reads_descriptors_that_may_not_be_written_to(model, tmp_path):
    np.save(tmp_path / "seen.npy", descriptors_at(poses_in_room(20, seed=3), 6).numpy())
    mapped = np.load(tmp_path / "seen.npy", mmap_mode="r")
    evidence = Camera(model, Likelihood(), mapped).observe(np.array([1, 2]))
    assert evidence.over_map().isfinite().all()


def test_an_image_is_likeliest_where_it_was_taken(model):
    poses = poses_in_room(30, seed=3)
    camera = Camera(model, Likelihood(), descriptors_at(poses, 6).numpy())
    elsewhere = poses.roll(7, dims=0)
    told = camera.observe(np.arange(30)).log_likelihood(torch.stack([poses, elsewhere], dim=1))
    assert (told[:, 0] > told[:, 1]).double().mean() > 0.9


def test_a_laser_hands_scans_and_map_poses_to_its_model():
    class Model:
        def observe(self, scans, map_poses):
            return scans, map_poses

    scans, poses = np.arange(30, dtype=np.float32).reshape(10, 3), poses_in_room(4)
    told, where = Laser(Model(), scans, poses).observe(np.array([3, 3, 9]))
    assert told.dtype == torch.float64
    np.testing.assert_array_equal(told.numpy(), scans[[3, 3, 9]])
    assert where is poses
