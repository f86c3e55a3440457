"""The moves a filter tolerates, and images moved by them."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from layers.cosfire.cosfire_cases import random_images
from scipy.ndimage import affine_transform

from sextant.layers.cosfire import Move, Tolerance
from sextant.layers.cosfire.tolerance import moved_image


@given(
    st.integers(1, 6),
    st.sampled_from([180.0, 360.0]),
    st.sets(st.sampled_from([0.5, 1.0, 2.0]), min_size=1),
    st.booleans(),
)
def test_all_combinations_are_moves_and_nothing_comes_first(rotations, span, scales, reflection):
    moves = list(Tolerance(rotations, span, tuple(scales), reflection).moves())
    assert len(moves) == len(set(moves)) == rotations * len(scales) * (1 + reflection)
    assert {round(math.degrees(move.rotation_rad), 9) for move in moves} == {
        round(span * turn / rotations, 9) for turn in range(rotations)
    }
    assert moves[0].nothing == (1.0 in scales)


@pytest.mark.parametrize(
    "options",
    [
        *[{"rotations": 0}, {"rotations": 2.5}, {"rotations": True}, {"span_deg": float("nan")}],
        *[{"scales": scales} for scales in ((), (0.0,), (1.0, float("nan")), (float("inf"),))],
    ],
)
def test_tolerances_that_cannot_be_are_refused(options):
    with pytest.raises(ValueError, match="tolerance needs"):
        Tolerance(**options)


@given(st.integers(0, 7), st.booleans(), st.tuples(st.integers(0, 6), st.integers(0, 4)))
def test_quarter_turns_and_mirrors_are_exact_and_take_the_point_along(quarters, mirrored, point):
    image = random_images(0, 1, 2, 5, 7)
    moved, (x, y) = moved_image(image, point, Move(quarters * math.pi / 2, 1.0, mirrored))
    assert torch.equal(moved, torch.rot90(image.flip(-1) if mirrored else image, quarters, (-2, -1)))
    assert torch.equal(moved[0, :, y, x], image[0, :, point[1], point[0]])


@given(st.floats(0.1, 6.0), st.sampled_from([0.7, 1.0, 1.5]))
def test_other_moves_are_those_of_scipy(angle, scale):
    image, (x, y) = random_images(0, 1, 1, 11, 9), (4.0, 6.0)
    moved, point = moved_image(image, (x, y), Move(angle, scale, False))
    cos, sin = math.cos(angle) / scale, math.sin(angle) / scale
    # rows and columns that a pixel comes from: turned clockwise, which with y downwards is counter-clockwise
    back = torch.tensor([[cos, sin], [-sin, cos]], dtype=torch.float64).numpy()
    offset = torch.tensor([y, x], dtype=torch.float64).numpy() - back @ [y, x]
    expected = affine_transform(image[0, 0].numpy(), back, offset, order=1, mode="nearest")
    assert point == (x, y)
    torch.testing.assert_close(moved[0, 0], torch.from_numpy(expected), rtol=0, atol=1e-9)


def test_an_image_one_pixel_wide_can_be_moved():
    moved, _ = moved_image(torch.ones(1, 1, 5, 1), (0.0, 2.0), Move(0.3, 1.0, False))
    torch.testing.assert_close(moved, torch.ones(1, 1, 5, 1))
