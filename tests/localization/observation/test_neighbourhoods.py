import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from localization.observation.smooth_map import KERNEL, poses_in_room

from sextant.localization.observation import neighbourhoods
from sextant.localization.observation.neighbourhoods import Neighbourhoods
from sextant.localization.pose_kernel import PoseKernel

far = st.sampled_from([1.0, 10.0, 1e3, 1e6, 1e12])


def _of_all(kernel, known, poses):
    """Squared distances by brute force."""
    return (kernel.features(poses)[:, None] - kernel.features(known)).square().sum(dim=2)


@given(st.integers(1, 300), st.integers(0, 9), far, st.floats(0.01, 100))
def test_the_nearest_image_is_that_of_brute_force(count, seed, spread, length):
    """Near the map, far from it, in dense and thin ones, and where the grid's cells are mostly empty."""
    kernel = PoseKernel("rbf", (length, 2 * length), 0.7, 1.0, 0.1)
    known, poses = poses_in_room(count, seed), poses_in_room(40, seed=seed + 50)
    known[: count // 4, :2] *= spread
    poses[:20, :2] = (poses[:20, :2] - 2.0) * spread
    squared = _of_all(kernel, known, poses)
    found = Neighbourhoods(known, kernel).nearest(poses)
    torch.testing.assert_close(squared.gather(1, found[:, None])[:, 0], squared.amin(dim=1), rtol=1e-9, atol=1e-12)


def test_the_nearest_image_may_be_in_another_ring_of_cells_than_the_first_that_is_found(monkeypatch):
    """With cells that are mostly empty, one straight ahead in the next ring is nearer than one in a corner of this."""
    monkeypatch.setattr(neighbourhoods, "IMAGES_A_CELL", 0.5)
    monkeypatch.setattr(neighbourhoods, "CELLS_AN_IMAGE", 32)
    for seed in range(10):
        known, poses = poses_in_room(200, seed), poses_in_room(500, seed=seed + 50)
        known[:, 2] = poses[:, 2] = 0.0
        squared = _of_all(KERNEL, known, poses)
        assert torch.equal(Neighbourhoods(known, KERNEL).nearest(poses), squared.argmin(dim=1))


@given(st.integers(1, 60), st.integers(0, 9))
def test_the_k_nearest_are_those_of_brute_force_in_order(k, seed):
    known, poses = poses_in_room(60, seed), poses_in_room(20, seed=seed + 50)
    expected = _of_all(KERNEL, known, poses).sort(dim=1)
    found = Neighbourhoods(known, KERNEL).of_poses(poses, k)
    assert torch.equal(found.rows, expected.indices[:, :k])
    torch.testing.assert_close(found.squared, expected.values[:, :k])


def test_many_headings_at_few_places_are_told_apart():
    places = poses_in_room(30)[:, None].expand(30, 36, 3).clone()
    places[:, :, 2] = torch.linspace(-math.pi, math.pi, 37, dtype=torch.float64)[:-1]
    known = places.reshape(-1, 3)
    assert torch.equal(Neighbourhoods(known, KERNEL).nearest(known + 1e-3), torch.arange(len(known)))


def test_many_headings_at_one_place_are_told_apart():
    known = torch.ones(100, 3, dtype=torch.float64)
    known[:, 2] = torch.linspace(-math.pi, math.pi, 101, dtype=torch.float64)[:-1]
    assert torch.equal(Neighbourhoods(known, KERNEL).nearest(known + 1e-3), torch.arange(100))


def test_a_line_and_a_single_image_work():
    line = torch.zeros(1000, 3, dtype=torch.float64)
    line[:, 0] = torch.arange(1000)
    asked = line + torch.tensor([0.3, 0.0, 0.0], dtype=torch.float64)
    assert torch.equal(Neighbourhoods(line, KERNEL).nearest(asked), torch.arange(1000))
    assert Neighbourhoods(line[:1], KERNEL).nearest(asked).unique().tolist() == [0]


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_pose_that_is_not_finite_is_refused(value):
    with pytest.raises(ValueError, match="finite"):
        Neighbourhoods(poses_in_room(9), KERNEL).nearest(torch.full((1, 3), value, dtype=torch.float64))
