import math

import numpy as np
import pytest
import torch
from jaxtyping import TypeCheckError
from small_worlds import generator

from sextant.errors import UserError
from sextant.geometry import se2_between
from sextant.localization.map_prior import MapPrior, half_spacing

POSES = torch.tensor([[0.0, 0.0, 0.0], [10.0, 0.0, math.pi / 2], [0.0, 20.0, 3.1]], dtype=torch.float64)


def test_every_image_is_as_likely_as_another():
    drawn = MapPrior(POSES, 0.0, 0.0).sample(4, 6000, generator())
    for pose in POSES:
        share = (drawn - pose).abs().amax(2).lt(1e-9).double().mean(1)
        assert bool(((share - 1 / 3).abs() < 5 * math.sqrt(2 / 9 / 6000)).all())


def test_jitter_lies_along_and_across_the_heading():
    rows = torch.arange(3).repeat(1, 20_000)
    drawn = MapPrior(POSES, (2.0, 0.5), 0.1).around(rows, generator())
    offsets = se2_between(POSES[rows], drawn)[0]
    assert offsets.mean(0).abs().max() < 0.04
    torch.testing.assert_close(offsets.std(0), torch.tensor([2.0, 0.5, 0.1]).double(), rtol=0.02, atol=0)
    assert bool((drawn[..., 2].abs() <= math.pi).all())


def test_one_deviation_serves_both_directions():
    assert MapPrior(POSES, 2.0, 0.1).sigmas == (2.0, 2.0, 0.1)


def test_a_railway_has_no_width():
    assert MapPrior(POSES[:1], (3.0, 0.0), 0.0).sample(1, 100, generator())[..., 1:].abs().max() == 0


def test_an_empty_map_is_refused():
    with pytest.raises(UserError, match="no image"):
        MapPrior(POSES[:0], 1.0, 0.1)


@pytest.mark.parametrize(
    ("position", "heading"),
    [(-1.0, 0.1), (1.0, -0.1), (math.nan, 0.1), ((1.0, math.inf), 0.1), ((1.0,), 0.1), ((1.0, 1.0, 1.0), 0.1)],
)
def test_deviations_must_be_finite_and_not_negative(position, heading):
    with pytest.raises((UserError, TypeCheckError), match=r"^position_sigma|Type-check error"):
        MapPrior(POSES, position, heading)


def test_a_deviation_may_be_a_number_of_numpy():
    assert MapPrior(POSES, np.float64(0.5), 0.1).sigmas == MapPrior(POSES, np.array(0.5), 0.1).sigmas == (0.5, 0.5, 0.1)


@pytest.mark.parametrize(
    ("poses", "told"), [(POSES * math.nan, "3 poses that are not finite"), (POSES[:, :2], r"must have \(n, 3\)")]
)
def test_poses_are_three_finite_numbers(poses, told):
    with pytest.raises((UserError, TypeCheckError), match=f"{told}|Type-check error"):
        MapPrior(poses, 1.0, 0.1)


def test_half_the_spacing_is_of_places_not_of_headings():
    """Of places 1, 1, 3 and 8 m from their next ones, two headings each, half the median is 1 m."""
    places = torch.tensor([0.0, 1.0, 4.0, 12.0], dtype=torch.float64).repeat(2)
    headings = torch.tensor([0.0, 3.0], dtype=torch.float64).repeat_interleave(4)
    assert half_spacing(torch.stack([places, 2 + 0 * places, headings], dim=1)) == 1.0
    assert half_spacing(POSES[:1]) == 0.5
