import math

import numpy as np
import pytest
import torch
from jaxtyping import TypeCheckError

from sextant.errors import UserError
from sextant.localization import descriptor_map
from sextant.localization.descriptor_map import DescriptorMap


def _poses(count=4):
    return torch.arange(3 * count, dtype=torch.float64).view(count, 3) / 10


def _descriptors(count=4):
    return torch.arange(2 * count, dtype=torch.float32).view(count, 2)


def test_a_map_keeps_its_arrays_and_knows_their_mean():
    poses, descriptors = _poses(), _descriptors()
    made = DescriptorMap.of(poses, descriptors)
    assert made.poses is poses
    assert made.descriptors is descriptors
    assert made.mean.tolist() == [3.0, 4.0]
    assert (len(made), made.dimension) == (4, 2)


def test_the_mean_of_many_descriptors_far_from_0_is_right(monkeypatch):
    monkeypatch.setattr(descriptor_map, "BLOCK", 64)
    generator = torch.Generator().manual_seed(0)
    descriptors = 1000 + torch.randn(5000, 3, generator=generator)
    poses = torch.randn(5000, 3, dtype=torch.float64, generator=generator)
    np.testing.assert_allclose(DescriptorMap.of(poses, descriptors).mean, descriptors.double().mean(dim=0), rtol=1e-7)


@pytest.mark.parametrize("count", [3, 5])
def test_a_pose_for_each_descriptor_is_needed(count):
    with pytest.raises(UserError, match=rf"{count} poses and 4 descriptors"):
        DescriptorMap.of(_poses(count), _descriptors())


def test_other_types_become_those_of_files():
    made = DescriptorMap.of(_poses().float(), _descriptors().double())
    assert (made.poses.dtype, made.descriptors.dtype) == (torch.float64, torch.float32)
    assert torch.equal(made.descriptors, _descriptors())
    with pytest.raises(UserError, match="1 descriptor that is not finite: row 1"):
        DescriptorMap.of(_poses(2), torch.tensor([[1.0], [1e300]], dtype=torch.float64))


def test_an_empty_map_is_refused():
    with pytest.raises(UserError, match="empty"):
        DescriptorMap.of(torch.zeros(0, 3, dtype=torch.float64), torch.zeros(0, 2))
    with pytest.raises(UserError, match="empty"):
        DescriptorMap.of(_poses(), torch.zeros(4, 0))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_values_that_are_not_finite_are_refused_with_their_rows(value):
    poses, descriptors = _poses(), _descriptors()
    poses[2, 1] = value
    with pytest.raises(UserError, match=r"1 pose that is not finite: row 2,"):
        DescriptorMap.of(poses, descriptors)
    descriptors[[1, 3], 0] = value
    with pytest.raises(UserError, match=r"2 descriptors that are not finite: rows 1, 3,"):
        DescriptorMap.of(_poses(), descriptors)


def test_equal_poses_are_refused_with_their_rows():
    poses = _poses(9)[[0, 1, 0, 2, 1, 1, 3, 0, 0]]
    with pytest.raises(UserError, match=r"5 poses equal to that of an earlier image .*: rows 2, 4, 5, 7, 8,"):
        DescriptorMap.of(poses, _descriptors(9))
    with pytest.raises(UserError, match=r"rows 1, 2, 3, 4, 5, \.\.\.,"):
        DescriptorMap.of(poses[[0] * 9], _descriptors(9))


def test_poses_a_turn_apart_or_of_either_zero_are_equal():
    poses = torch.tensor([[0.0, 1.0, 0.0], [-0.0, 1.0, 2 * math.pi]], dtype=torch.float64)
    with pytest.raises(UserError, match="row 1,"):
        DescriptorMap.of(poses, _descriptors(2))


def test_other_headings_at_one_place_are_legal():
    poses = torch.zeros(8, 3, dtype=torch.float64)
    poses[:, 2] = torch.arange(8) * math.pi / 4
    assert len(DescriptorMap.of(poses, _descriptors(8))) == 8


def test_equal_poses_can_be_merged_into_their_mean():
    poses = _poses(3)[[2, 0, 2, 1, 0]]
    made = DescriptorMap.of(poses, _descriptors(5), merge_duplicates=True)
    assert torch.equal(made.poses, _poses(3)[[2, 0, 1]])
    assert made.descriptors.tolist() == [[2.0, 3.0], [5.0, 6.0], [6.0, 7.0]]


def test_merging_a_map_without_equal_poses_copies_nothing():
    descriptors = _descriptors()
    assert DescriptorMap.of(_poses(), descriptors, merge_duplicates=True).descriptors is descriptors


@pytest.mark.parametrize(
    ("poses", "descriptors"),
    [
        (_poses()[:, :2], _descriptors()),
        (_poses().repeat(1, 2)[:, :4], _descriptors()),
        (_poses()[:, 0], _descriptors()),
        (_poses(), _descriptors()[:, 0]),
        (_poses(), _descriptors()[..., None]),
    ],
)
def test_poses_and_descriptors_are_rows(poses, descriptors):
    with pytest.raises((UserError, TypeCheckError), match=r"(poses|descriptors) has .* must have|Type-check error"):
        DescriptorMap.of(poses, descriptors)
