from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import TypeCheckError
from scipy.linalg import expm

from sextant.errors import UserError
from sextant.worlds.odometry import (
    COLD_WHEELS,
    at_axle,
    drift,
    fit_odometry_noise,
    increments,
    integrate,
    simulate,
)
from sextant.worlds.routes import walk
from sextant.worlds.street_layouts import grid_streets
from sextant.worlds.tours import random_walk
from sextant.worlds.trajectories import load_cold

small = st.floats(-2, 2)


def matrix(pose):
    x, y, heading = pose
    return np.array([[np.cos(heading), -np.sin(heading), x], [np.sin(heading), np.cos(heading), y], [0, 0, 1]])


def curve(seed, frames=4000, step=0.04):
    """A robot that drives ahead and turns now and then."""
    rng = np.random.default_rng(seed)
    turn = np.repeat(rng.normal(scale=0.03, size=frames // 20), 20)
    return integrate(np.array([1.0, 2.0, 0.5]), np.column_stack([np.full(frames, step), np.zeros(frames), turn]))


@given(small, small, st.one_of(st.floats(-3, 3), st.floats(-1e-5, 1e-5)))
def test_integrate_is_the_matrix_exponential_and_increments_its_inverse(x, y, turn):
    poses = integrate(np.array([0.3, -0.2, 1.0]), np.array([[x, y, turn]]))
    generator = np.array([[0, -turn, x], [turn, 0, y], [0, 0, 0]])
    assert np.allclose(matrix(poses[1]), matrix(poses[0]) @ expm(generator), atol=1e-9)
    assert np.allclose(increments(poses), [[x, y, turn]], atol=1e-9)


def test_perfect_odometry_is_the_truth():
    true = curve(0)
    assert np.allclose(simulate(true, COLD_WHEELS.scaled(0), np.random.default_rng(0)), true)


def test_standing_still_adds_no_error():
    true = np.tile([1.0, 2.0, 3.0], (50, 1))
    assert np.allclose(simulate(true, COLD_WHEELS, np.random.default_rng(0)), true)


def test_simulated_odometry_is_a_function_of_the_generator():
    true = curve(0, frames=400)
    a, b, c = (simulate(true, COLD_WHEELS, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)


def test_drift_does_not_depend_on_the_frame_rate():
    fine = curve(1, frames=4000)
    coarse = fine[::10]
    errors = [
        np.mean(
            [drift(true, simulate(true, COLD_WHEELS, np.random.default_rng(seed)), 10.0) for seed in range(30)], axis=0
        )
        for true in (fine, coarse)
    ]
    assert errors[0] == pytest.approx(errors[1], rel=0.1)


def test_the_fit_finds_the_noise_that_was_put_in():
    true = at_axle(curve(3, frames=40_000), -COLD_WHEELS.lever_m)
    odometry = at_axle(simulate(true, COLD_WHEELS, np.random.default_rng(4)), COLD_WHEELS.lever_m)
    noise = fit_odometry_noise(true, odometry)
    assert noise.lever_m == pytest.approx(COLD_WHEELS.lever_m, abs=0.01)
    assert noise.turn_bias == pytest.approx(COLD_WHEELS.turn_bias, rel=0.15)
    assert noise.forward_scale == pytest.approx(COLD_WHEELS.forward_scale, abs=0.004)
    assert noise.per_metre == pytest.approx(COLD_WHEELS.per_metre, rel=0.3)


def test_scaled_noise_drifts_in_proportion():
    true = curve(5)
    once, half = (
        np.mean([drift(true, simulate(true, noise, np.random.default_rng(seed)), 5.0) for seed in range(30)], axis=0)
        for noise in (COLD_WHEELS, COLD_WHEELS.scaled(0.5))
    )
    assert 2 * half == pytest.approx(once, rel=0.1)


def test_a_simulated_walk_drifts_as_the_robot_does():
    graph = grid_streets(3, 3, 60)
    route = walk(graph, random_walk(graph, 300, 0), seed=0)
    translation, heading = drift(route.poses, simulate(route.poses, COLD_WHEELS, np.random.default_rng(0)), 10.0)
    assert 0.4 < translation < 3
    assert 0.15 < heading < 0.6


@pytest.mark.real_data
def test_the_constants_are_those_of_the_real_robot(real_data):
    cold = load_cold(real_data / "cold" / "seq1_night1.json")
    noise = fit_odometry_noise(cold.poses, cold.odometry)
    for field in fields(noise):
        assert getattr(COLD_WHEELS, field.name) == pytest.approx(getattr(noise, field.name), rel=0.02, abs=1e-5), (
            field.name
        )


@pytest.mark.real_data
@pytest.mark.parametrize("length", [5.0, 10.0, 20.0])
def test_simulated_drift_is_within_a_factor_of_1_3_of_the_real_one(real_data, length):
    cold = load_cold(real_data / "cold" / "seq1_night1.json")
    real = np.array(drift(at_axle(cold.poses, COLD_WHEELS.lever_m), cold.odometry, length))
    runs = [
        drift(cold.poses, simulate(cold.poses, COLD_WHEELS, np.random.default_rng(seed)), length) for seed in range(30)
    ]
    ratio = real / np.median(runs, axis=0)
    assert np.all((ratio > 1 / 1.3) & (ratio < 1.3)), ratio


def test_what_cannot_be_fitted_is_told():
    true = curve(0)
    with pytest.raises((UserError, TypeCheckError), match=r"same frames|Type-check error"):
        fit_odometry_noise(true, true[:-1])
    with pytest.raises(UserError, match="too short"):
        fit_odometry_noise(true[:100], true[:100])


def test_a_stretch_longer_than_the_drive_has_no_drift():
    assert np.isnan(drift(curve(0, frames=100), curve(0, frames=100), 50.0)).all()
