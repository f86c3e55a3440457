import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds.casters import Boxes, Circle, Nothing

from sextant.errors import UserError
from sextant.worlds.laser import LaserScanner, scan

EXACT = LaserScanner(beams=91, range_sigma_m=0.0, max_range_m=100.0)


def rng(seed=0):
    return np.random.default_rng(seed)


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(-4, 4))
def test_in_a_circle_every_beam_ends_on_it(x, y, heading):
    pose = np.array([[x, y, heading]])
    ranges = scan(EXACT, Circle(10), pose, rng())[0]
    bearing = heading + EXACT.angles
    ends = pose[0, :2] + ranges[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing)])
    assert np.allclose(np.linalg.norm(ends, axis=1), 10)


def test_beams_go_from_right_to_left():
    ahead, left, right = 3.0, 2.0, 1.0
    ranges = scan(LaserScanner(3, np.pi, 50, 0.3, 0.0), Boxes((-9, -right, ahead, left)), np.zeros((1, 3)), rng())
    assert np.allclose(ranges, [[right, ahead, left]])


@pytest.mark.parametrize("beams", [1, 2, 7, 360])
def test_a_full_turn_does_not_look_twice_into_a_direction(beams):
    angles = LaserScanner(beams, 2 * np.pi).angles
    assert len(angles) == beams
    assert len(np.unique(np.round(np.angle(np.exp(1j * angles)), 9))) == beams


def test_noise_has_the_spread_it_states():
    scanner = LaserScanner(500, np.pi, 100, 0.3, range_sigma_m=0.05)
    errors = scan(scanner, Circle(10), np.zeros((40, 3)), rng()) - 10
    assert errors.std() == pytest.approx(0.05, rel=0.03)
    assert abs(errors.mean()) < 0.002


def test_dropouts_and_misses_return_the_maximum():
    scanner = LaserScanner(500, np.pi, 50, 0.3, 0.01, dropout=0.2)
    ranges = scan(scanner, Circle(10), np.zeros((40, 3)), rng())
    assert np.mean(ranges == 50) == pytest.approx(0.2, abs=0.02)
    assert np.all(scan(scanner, Nothing(), np.zeros((2, 3)), rng()) == 50)
    assert np.all(scan(LaserScanner(max_range_m=5), Circle(10), np.zeros((2, 3)), rng()) == 5)


def test_ranges_stay_within_the_scanner():
    scanner = LaserScanner(200, np.pi, 10, 0.3, range_sigma_m=5.0)
    ranges = scan(scanner, Circle(9), np.zeros((5, 3)), rng())
    assert ranges.min() >= 0
    assert ranges.max() <= 10


def test_a_scan_is_a_function_of_the_generator():
    a, b, c = (scan(LaserScanner(), Circle(9), np.zeros((2, 3)), rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)


@pytest.mark.parametrize(
    ("key", "value"),
    [("beams", 0), ("field_of_view_rad", 7.0), ("max_range_m", 0.0), ("range_sigma_m", -1.0), ("dropout", 1.5)],
)
def test_an_impossible_scanner_is_told(key, value):
    with pytest.raises(UserError, match=rf"^{key}={value:g}"):
        LaserScanner(**{key: value})
