import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import TypeCheckError

from sextant.errors import UserError
from sextant.localization.tiled_map import spatial_order


@given(st.integers(0, 200), st.integers(0, 9))
def test_every_row_comes_once(count, seed):
    poses = torch.randn(count, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
    assert sorted(spatial_order(poses).tolist()) == list(range(count))


def test_a_grid_is_walked_in_the_shape_of_z():
    x, y = torch.meshgrid(torch.arange(4.0), torch.arange(4.0), indexing="xy")
    poses = torch.stack([x.flatten(), y.flatten(), torch.zeros(16)], dim=1).double()
    walked = poses[spatial_order(poses), :2].tolist()
    assert walked[:8] == [[0, 0], [1, 0], [0, 1], [1, 1], [2, 0], [3, 0], [2, 1], [3, 1]]


def test_images_at_one_place_follow_each_other_by_heading():
    places = torch.randn(30, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    headings = torch.tensor([2.0, -1.0, 0.5], dtype=torch.float64)
    poses = torch.cat([places.repeat(3, 1), headings.repeat_interleave(30)[:, None]], dim=1)
    ordered = poses[spatial_order(poses)].view(30, 3, 3)
    assert (ordered[:, :, :2] == ordered[:, :1, :2]).all()
    assert (ordered[:, :, 2] == headings.sort().values).all()


def test_neighbours_lie_in_few_pages():
    """16 nearest of 20,000 in pages of 8 rows: a random order needs nearly 16 pages, this one a fraction."""
    poses = torch.rand(20_000, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    place = np.empty(len(poses), np.int64)
    place[spatial_order(poses).numpy()] = np.arange(len(poses))
    near = (poses[:50, None, :2] - poses[None, :, :2]).norm(dim=2).argsort(dim=1)[:, :16].numpy()
    pages = np.mean([len(set(place[rows] // 8)) for rows in near])
    assert pages < 8
    assert np.mean([len(set(rows // 8)) for rows in near]) > 15


def test_a_map_of_one_place_and_an_empty_one_work():
    assert spatial_order(torch.zeros(1, 3, dtype=torch.float64)).tolist() == [0]
    assert spatial_order(torch.zeros(0, 3, dtype=torch.float64)).tolist() == []


def test_a_pose_that_is_not_a_number_is_refused():
    with pytest.raises(ValueError, match="finite"):
        spatial_order(torch.full((1, 3), torch.nan, dtype=torch.float64))
    with pytest.raises((UserError, TypeCheckError), match=r"must have \(n, 3\)|Type-check error"):
        spatial_order(torch.zeros(4, 2, dtype=torch.float64))
