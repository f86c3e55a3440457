"""Densities of images against those of independent code, and times of sensors of known slowness."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest
import torch
from localization.observation.smooth_map import KERNEL, descriptors_at, poses_in_room, smooth_map
from scipy import stats

from sextant.chapters.localization.data.drive import Drive
from sextant.chapters.localization.sensor_measures import IMAGES, PARTICLES, descriptor_nll, looked_at, sensor_cost
from sextant.evaluation.protocols import NORDLAND_LOCALIZATION, OFFICE_LOCALIZATION
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation.evidence import Evidence
from sextant.localization.observation.exact_gp import ExactGP
from sextant.localization.observers import Observer

NOISE = Likelihood(tempering=0.1, appearance_variance=0.02)


@pytest.fixture(scope="module")
def seen():
    poses = poses_in_room(30, seed=4)
    return descriptors_at(poses, 6), poses


def test_the_density_is_that_of_independent_normal_numbers(seen):
    descriptors, poses = seen
    model = ExactGP(max_images=500).fit(smooth_map(), KERNEL)
    told = model.predict(poses)
    sigma = (told.variance + 0.02).sqrt()[:, None].numpy()
    expected = -stats.norm.logpdf(descriptors.numpy(), told.mean.numpy(), sigma).mean()
    assert descriptor_nll(model, NOISE, descriptors, poses) == pytest.approx(expected, rel=1e-9)


def test_the_density_of_the_student_form_is_scipys(seen):
    descriptors, poses = seen
    model = ExactGP(max_images=500).fit(smooth_map(), KERNEL)
    told = model.predict(poses)
    each = [
        stats.multivariate_t.logpdf(z, mean, (variance + 0.02) * np.eye(len(z)), df=4.0)
        for z, mean, variance in zip(descriptors.numpy(), told.mean.numpy(), told.variance.tolist(), strict=True)
    ]
    expected = -np.mean(each) / descriptors.shape[1]
    assert descriptor_nll(model, replace(NOISE, form="student"), descriptors, poses) == pytest.approx(expected)


def test_a_univariate_likelihood_is_no_density_of_descriptors(seen):
    model = ExactGP(max_images=500).fit(smooth_map(), KERNEL)
    assert math.isnan(descriptor_nll(model, replace(NOISE, form="univariate"), *seen))


class Slow(Observer, Evidence):
    """Takes 2 ms to look and 5 ms to weigh, and notes what it is asked."""

    def __init__(self):
        self.asked = []

    def observe(self, frames):
        time.sleep(0.002)
        self.frames = frames
        return self

    def log_likelihood(self, poses):
        time.sleep(0.005)
        self.asked.append(poses)
        return poses[..., 0]

    def over_map(self):
        raise AssertionError("nothing asks for it")


def drive(seen):
    poses = np.column_stack([np.arange(len(seen)), np.zeros(len(seen)), np.full(len(seen), 0.5)])
    return Drive("run", "day", poses.astype(float), None, None, np.asarray(seen, bool), np.arange(len(seen)))


def test_what_a_sensor_costs_is_told_apart():
    slow = Slow()
    cost = sensor_cost(slow, drive([0, 0, 1, 1]), OFFICE_LOCALIZATION)
    assert 5000 / PARTICLES <= cost.us_per_particle < 20_000 / PARTICLES
    assert 2 <= cost.ms_per_image < 8
    assert slow.frames.tolist() == [2]
    poses = slow.asked[0][0]
    torch.testing.assert_close(poses.mean(0), torch.tensor([2.0, 0.0, 0.5], dtype=torch.float64), atol=0.05, rtol=0)
    spread = torch.tensor([0.5, 0.5, math.radians(10)], dtype=torch.float64)
    torch.testing.assert_close(poses.std(0), spread, atol=0.0, rtol=0.1)


def test_along_a_railway_poses_stay_on_it():
    slow = Slow()
    sensor_cost(slow, drive([1]), NORDLAND_LOCALIZATION)
    away = slow.asked[0][0] - torch.tensor([0.0, 0.0, 0.5], dtype=torch.float64)
    assert float((away[:, 0] * math.sin(0.5) - away[:, 1] * math.cos(0.5)).abs().max()) < 1e-12
    assert float(away[:, 2].abs().max()) == 0


def test_nothing_can_be_timed_where_nothing_is_seen():
    with pytest.raises(ValueError, match="the drive run has no observation"):
        sensor_cost(Slow(), drive([0, 0]), OFFICE_LOCALIZATION)


def test_images_are_looked_at_evenly():
    rows = looked_at(drive([0] + [1] * (3 * IMAGES)))
    assert len(rows) == IMAGES
    assert set(np.diff(rows)) == {3}
