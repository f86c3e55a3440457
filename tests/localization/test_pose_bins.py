import math

import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.localization.kld_size import PoseBins

poses = st.lists(
    st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-math.pi, math.pi)), min_size=1, max_size=30
)


@given(poses)
def test_keys_tell_boxes_apart_like_sets_do(rows):
    bins = PoseBins(3.0, 0.5)
    cells = bins.cells(torch.tensor([rows], dtype=torch.float64))
    keys = bins.keys(cells)[0].tolist()
    boxes = [tuple(cell) for cell in cells[0].tolist()]
    assert len(set(keys)) == len(set(boxes))
    assert len(set(zip(keys, boxes, strict=True))) == len(set(boxes))
    assert int(bins.occupied(torch.tensor([rows], dtype=torch.float64))) == len(set(boxes))


def test_boxes_of_one_run_do_not_count_in_another():
    run = torch.zeros(2, 3, 3, dtype=torch.float64)
    run[1, :, 0] = torch.tensor([0.0, 10.0, 20.0])
    assert PoseBins(1.0, 1.0).occupied(run).tolist() == [1, 3]


@given(st.floats(0.05, 10), st.floats(-math.pi, math.pi), st.integers(-2, 2))
def test_headings_a_turn_apart_share_a_box(width, heading, turns):
    pose = torch.tensor([[[0.0, 0.0, heading], [0.0, 0.0, heading + 2 * math.pi * turns]]], dtype=torch.float64)
    bins = PoseBins(1.0, width)
    first, second = bins.cells(pose)[0, :, 2].tolist()
    assert 0 <= first < bins.turns
    gap = abs(first - second)
    assert min(gap, bins.turns - gap) <= 1  # rounding may push a pose on an edge over it
