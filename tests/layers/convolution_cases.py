"""Convolutions of any geometry, with images for them."""

import torch
from hypothesis import strategies as st
from torch import nn

NUMPY_BORDER = {"zeros": "constant", "reflect": "reflect", "replicate": "edge", "circular": "wrap"}


@st.composite
def convolutions(draw):
    """A convolution of any geometry, and images for it."""
    torch.manual_seed(draw(st.integers(0, 99)))
    groups = draw(st.integers(1, 2))
    stride = draw(st.tuples(st.integers(1, 3), st.integers(1, 3)))
    paddings = st.tuples(st.integers(0, 2), st.integers(0, 2)) | st.sampled_from(["same", "valid"])
    if stride != (1, 1):
        paddings = paddings.filter(lambda padding: padding != "same")
    conv = nn.Conv2d(
        groups * draw(st.integers(1, 2)),
        groups * draw(st.integers(1, 2)),
        draw(st.tuples(st.sampled_from([1, 3, 5]), st.sampled_from([1, 3, 5]))),
        stride,
        draw(paddings),
        draw(st.tuples(st.integers(1, 2), st.integers(1, 2))),
        groups,
        draw(st.booleans()),
        draw(st.sampled_from(list(NUMPY_BORDER))),
        dtype=torch.float64,
    )
    height, width = draw(st.tuples(st.integers(13, 16), st.integers(13, 16)))
    return conv, torch.randn(2, conv.in_channels, height, width, dtype=torch.float64)
