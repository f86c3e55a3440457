"""Borders against numpy's."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from layers.convolution_cases import NUMPY_BORDER

from sextant.layers.cosfire.blur import padded


@given(
    st.tuples(st.integers(1, 5), st.integers(1, 5)),
    st.integers(0, 14),
    st.sampled_from(["zeros", "replicate", "reflect", "circular"]),
    st.integers(0, 99),
)
def test_any_margin_is_numpys(size, margin, border, seed):
    maps = np.random.default_rng(seed).normal(size=(2, 3, *size))
    expected = np.pad(maps, [(0, 0), (0, 0), (margin,) * 2, (margin,) * 2], mode=NUMPY_BORDER[border])
    np.testing.assert_array_equal(padded(torch.from_numpy(maps), margin, border), expected)


@pytest.mark.parametrize("fill", [0.5, -np.inf])
def test_beyond_the_border_of_zeros_stands_what_is_told(fill):
    wide = padded(torch.ones(2, 3), 2, "zeros", fill)
    assert torch.equal(wide[2:-2, 2:-2], torch.ones(2, 3))
    assert (wide == fill).sum() == wide.numel() - 6
