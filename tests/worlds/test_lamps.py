import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sextant.worlds.lamps import NEAREST, REACH_M, Lamps


@given(st.integers(1, 60), st.integers(0, 1000))
def test_cells_hold_the_nearest_lamps_within_reach(n, seed):
    position = np.random.default_rng(seed).uniform(-150, 90, (n, 3))
    lamps = Lamps.at(position)
    left, bottom, side = lamps.origin
    shape = lamps.cells.shape[:2]
    assert position[:, 0].max() + REACH_M <= left + side * shape[0] + 1e-9
    assert position[:, 1].min() - REACH_M >= bottom - 1e-9
    for i, j in np.random.default_rng(seed).integers(0, shape, (20, 2)):
        centre = np.array([left, bottom]) + side * (np.array([i, j]) + 0.5)
        distance = np.linalg.norm(position[:, :2] - centre, axis=1)
        expected = [k for k in np.argsort(distance)[:NEAREST] if distance[k] < REACH_M]
        found = lamps.cells[i, j]
        assert found[: len(expected)].tolist() == expected
        assert (found[len(expected) :] == -1).all()


def test_no_lamps_light_nothing():
    lamps = Lamps.at(np.zeros((0, 3)))
    assert len(lamps.position) == 0
    assert (lamps.cells == -1).all()
