"""Blurs against brute force over all offsets."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from layers.cosfire.cosfire_cases import BORDERS, random_images
from layers.cosfire.plain_cosfire import blurred

from sextant.errors import UserError
from sextant.layers.cosfire import Blur, gaussian_blur, max_blur


@given(
    st.sampled_from(["max", "sum"]),
    st.floats(0.1, 3.0),
    st.floats(1.0, 4.0),
    st.sampled_from([None, 0, 1, 4]),
    st.sampled_from(BORDERS),
    st.tuples(st.integers(1, 9), st.integers(1, 9)),
)
def test_a_blur_is_that_over_all_offsets(kind, sigma, reach, fixed_reach, border, size):
    blur = Blur(kind=kind, reach=reach, fixed_reach=fixed_reach, border=border)
    maps = random_images(0, 2, 1, *size)
    expected = np.stack([[blurred(map_[0], sigma, blur)] for map_ in maps.numpy()])
    np.testing.assert_allclose(blur(maps, sigma), expected, rtol=1e-12)


def test_no_width_is_no_blur():
    maps = random_images(0, 1, 1, 5, 5)
    assert all(torch.equal(Blur(kind=kind)(maps, 0.0), maps) for kind in ("max", "sum"))


def test_the_maximum_of_a_dot_is_a_gaussian_that_is_not_normalised():
    dot = torch.zeros(9, 9, dtype=torch.float64)
    dot[4, 4] = 2
    blurred = max_blur(dot, 1.5, 4)
    rows, columns = np.mgrid[-4:5, -4:5]
    np.testing.assert_allclose(blurred, 2 * np.exp(-(rows**2 + columns**2) / 4.5))


@pytest.mark.parametrize("border", ["replicate", "reflect", "circular"])
def test_the_sum_of_what_is_level_stays_level(border):
    level = torch.full((7, 5), 3.0, dtype=torch.float64)
    torch.testing.assert_close(gaussian_blur(level, 2.0, 6, border), level)


@pytest.mark.parametrize(
    "options",
    [
        *[{"sigma0": -1.0}, {"alpha": -0.1}, {"kind": "mean"}, {"reach": -1.0}, {"fixed_reach": -1}],
        *[{name: float("nan")} for name in ("sigma0", "alpha", "reach", "fixed_reach")],
        *[{"sigma0": float("inf")}, {"fixed_reach": 2.5}],
    ],
)
def test_blurs_that_cannot_be_are_refused(options):
    with pytest.raises(ValueError, match="blur needs"):
        Blur(**options)


def test_an_unknown_border_is_refused():
    with pytest.raises(ValueError, match="border must be one of"):
        Blur(border="mirror")


def test_sums_of_bytes_are_refused_as_they_would_run_over():
    with pytest.raises(UserError, match=r"floating-point maps, got torch\.uint8"):
        gaussian_blur(torch.full((1, 9, 9), 200, dtype=torch.uint8), 1.0, 2)
