import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, stats

from sextant.evaluation.pose_posterior import (
    LEVELS,
    PLANE,
    POSITION,
    RAILWAY,
    nees,
    particle_nll,
    pose_errors,
    posterior_calibration,
)

COVARIANCE = np.array([[0.09, 0.03, 0.004], [0.03, 0.04, -0.003], [0.004, -0.003, 0.01]])


def gaussian_truths(number, covariance=COVARIANCE, seed=0):
    """Poses all around the circle, and truths that lie about them as the covariance says."""
    rng = np.random.default_rng(seed)
    mean = rng.uniform((-9, -9, -np.pi), (9, 9, np.pi), (number, 3))
    return mean + rng.multivariate_normal(np.zeros(3), covariance, number), mean


@pytest.mark.parametrize("axes", [PLANE, POSITION, RAILWAY])
def test_a_known_gaussian_is_calibrated(axes):
    number = 4000
    truth, mean = gaussian_truths(number)
    values = nees(truth, mean, np.broadcast_to(COVARIANCE, (number, 3, 3)), axes)
    found = posterior_calibration(values, len(axes))
    assert found.mean == pytest.approx(len(axes), abs=4 * math.sqrt(2 * len(axes) / number))
    for level in LEVELS:
        assert found.coverage[level] == pytest.approx(level, abs=4 * math.sqrt(level * (1 - level) / number))
    assert stats.kstest(values, stats.chi2(len(axes)).cdf).pvalue > 1e-3


def test_an_overconfident_posterior_is_found_out():
    truth, mean = gaussian_truths(500)
    found = posterior_calibration(nees(truth, mean, np.broadcast_to(COVARIANCE / 4, (500, 3, 3))), 3)
    assert found.mean > found.high
    assert found.mean == pytest.approx(12, rel=0.1)
    assert found.coverage[0.95] < 0.75
    timid = posterior_calibration(nees(truth, mean, np.broadcast_to(COVARIANCE * 4, (500, 3, 3))), 3)
    assert timid.mean < timid.low


def test_the_interval_holds_calibrated_means_as_often_as_it_says():
    held = []
    for seed in range(400):
        truth, mean = gaussian_truths(10, seed=seed)
        found = posterior_calibration(nees(truth, mean, np.broadcast_to(COVARIANCE, (10, 3, 3))), 3)
        held.append(found.low <= found.mean <= found.high)
    assert np.mean(held) == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / 400))


def test_frames_of_one_drive_may_count_as_one():
    values = np.full(100, 3.0)
    all_of_them, one = (posterior_calibration(values, 3, independent=n) for n in (None, 1))
    assert one.high - one.low > 5 * (all_of_them.high - all_of_them.low)
    for bad in (np.zeros(0), np.array([np.nan])):
        with pytest.raises(ValueError, match="NEES values"):
            posterior_calibration(bad, 3)


@given(st.floats(-3, 3), st.integers(-2, 2))
def test_errors_wrap(error, turns):
    truth = np.array([[1.0, 2.0, 3.0 + error + 2 * np.pi * turns]])
    assert pose_errors(truth, np.array([[0.5, 2.0, 3.0]]))[0] == pytest.approx([0.5, 0.0, error])


@given(st.integers(0, 1000), st.floats(0.01, 100))
def test_nees_does_not_depend_on_units(seed, unit):
    """Metres or centimetres: the answer is a number without unit."""
    truth, mean = gaussian_truths(5, seed=seed)
    scale = np.array([unit, unit, 1.0])
    covariance = np.broadcast_to(COVARIANCE, (5, 3, 3))
    np.testing.assert_allclose(
        nees(truth * scale, mean * scale, covariance * np.outer(scale, scale)), nees(truth, mean, covariance), rtol=1e-6
    )


def test_no_variance_is_no_excuse():
    """All particles at one place: right or infinitely wrong."""
    mean, collapsed = np.zeros((2, 3)), np.zeros((2, 3, 3))
    truth = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
    assert nees(truth, mean, collapsed).tolist() == [0, np.inf]
    railway = np.zeros((2, 3, 3))
    railway[:, 0, 0] = 0.01
    assert nees(truth, mean, railway, RAILWAY) == pytest.approx([0, 1])


class TestParticleDensity:
    POSES = np.array([[0.0, 0.0, 3.0], [0.4, -0.2, -3.0]])
    LOG_WEIGHTS = np.log([0.25, 0.75])

    def nll(self, truth, axes=PLANE, **changes):
        settings = {"bandwidth_m": 0.3, "bandwidth_rad": 0.5, "axes": axes} | changes
        return particle_nll(np.asarray(truth, float), self.POSES, self.LOG_WEIGHTS, **settings)

    def nll_of_many(self, truths):
        poses = np.broadcast_to(self.POSES, (len(truths), 2, 3))
        log_weights = np.broadcast_to(self.LOG_WEIGHTS, (len(truths), 2))
        return particle_nll(truths, poses, log_weights, bandwidth_m=0.3, bandwidth_rad=0.5)

    def test_by_hand(self):
        truth = np.array([0.1, 0.2, -3.1])
        density = sum(
            weight
            * stats.norm.pdf(truth[0] - x, scale=0.3)
            * stats.norm.pdf(truth[1] - y, scale=0.3)
            * stats.vonmises.pdf(truth[2] - heading, 1 / 0.5**2)
            for weight, (x, y, heading) in zip((0.25, 0.75), self.POSES, strict=True)
        )
        assert float(self.nll(truth)) == pytest.approx(-math.log(density))

    def test_it_integrates_to_one(self):
        axis, turn = np.linspace(-3, 3, 121), np.linspace(-np.pi, np.pi, 73)[:-1]
        x, y, heading = np.meshgrid(axis, axis, turn, indexing="ij")
        poses = np.stack([x, y, heading], axis=-1).reshape(-1, 3)
        density = [np.exp(-self.nll_of_many(some)) for some in np.array_split(poses, 10)]
        assert np.concatenate(density).sum() * 0.05**2 * (2 * np.pi / 72) == pytest.approx(1, abs=1e-6)
        along = integrate.quad(lambda value: float(np.exp(-self.nll([value, 0, 0], RAILWAY))), -4, 4)[0]
        assert along == pytest.approx(1, abs=1e-6)

    @given(st.floats(-4, 4), st.integers(-3, 3))
    def test_it_is_periodic(self, heading, turns):
        once, again = (self.nll([0.1, 0.2, value]) for value in (heading, heading + 2 * np.pi * turns))
        assert float(once) == pytest.approx(float(again))

    def test_a_background_bounds_it(self):
        far = [1000.0, 0.0, 0.0]
        uniform = 1 / (50 * 40 * 2 * np.pi)
        assert float(self.nll(far)) > 1e6
        bounded = float(self.nll(far, background=0.01, background_density=uniform))
        assert bounded == pytest.approx(-math.log(0.01 * uniform))
        near = [0.1, 0.0, 3.1]
        expected = -math.log(0.99 * math.exp(-self.nll(near)) + 0.01 * uniform)
        assert float(self.nll(near, background=0.01, background_density=uniform)) == pytest.approx(expected)

    @pytest.mark.parametrize(
        "change", [{"bandwidth_m": 0.0}, {"bandwidth_rad": -1.0}, {"background": 1.0}, {"background": 0.1}]
    )
    def test_impossible_settings_are_refused(self, change):
        with pytest.raises(ValueError, match="must be"):
            self.nll([0, 0, 0], **change)

    def test_particles_of_a_gaussian_give_nearly_its_entropy(self):
        rng = np.random.default_rng(0)
        truth, mean = gaussian_truths(200)
        particles = mean[:, None] + rng.multivariate_normal(np.zeros(3), COVARIANCE, (200, 1000))
        values = particle_nll(truth, particles, np.zeros((200, 1000)), bandwidth_m=0.08, bandwidth_rad=0.05)
        entropy = 0.5 * np.linalg.slogdet(2 * np.pi * math.e * COVARIANCE)[1]
        assert values.mean() == pytest.approx(entropy, abs=0.25)
