"""Stripes, dotted lines and zigzags against loops over pixels."""

import math
from itertools import pairwise

import numpy as np
import pytest
import torch

from sextant.corruptions.shapes import DottedLine, Stripe, Zigzag, line_overlay, mnist_cells, mnist_coordinates

ONE = ((),)
BLACK = torch.zeros(1, 1, 28, 28, dtype=torch.float64)


def line(c0, r0, c1, r1):
    """One line, pixel by pixel."""
    image = np.zeros((28, 28))
    if c0 == c1:
        return image
    for column in range(max(math.floor(c0), 0), min(math.ceil(c1), 28)):
        height = r0 + (r1 - r0) / (c1 - c0) * (column - c0)
        for row in range(28):
            distance = abs(row - height)
            if distance < 2.3:
                image[row, column] = max(0.0, 1 + math.log(1 - distance / 2.3))
    return image


def zigzag(start, rise, mode):
    """The line's corners walked one after the other; length, then turn, then shift."""
    angle = math.atan(rise / 23)
    length = 23 / math.cos(angle)
    points, at, side = [(0.0, 0.0)], 2.0, 1
    while at <= length:
        points.append((at, 2.0 * side))
        at, side = at + 4, -side
    last = points[-1][1]
    whole = 4 * (length // 4)
    wave = {
        "faithful": last / (2 * (length - whole)),
        "corrected": 2 * 2 / math.pi * math.asin(math.sin(math.pi * length / 4)),
    }
    points.append((length, wave[mode]))
    turned = [
        (2 + u * math.cos(angle) - v * math.sin(angle), start + u * math.sin(angle) + v * math.cos(angle))
        for u, v in points
    ]
    image = np.zeros((28, 28))
    for (c0, r0), (c1, r1) in pairwise(turned):
        image = np.clip(image + line(c0, r0, c1, r1), 0, 1)
    return image


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_stripes_invert_the_outer_columns_exactly(dtype):
    clean = torch.rand(3, 1, 28, 28, dtype=dtype)
    striped = Stripe(ONE, "stripe", levels=(1,))(clean, 1, torch.arange(3), 0)
    assert torch.equal(striped[..., 7:21], clean[..., 7:21])
    assert torch.equal(striped[..., :7], 1 - clean[..., :7])
    assert torch.equal(striped[..., 21:], 1 - clean[..., 21:])


@pytest.mark.parametrize(("width", "quarter"), [(32, 8), (224, 56), (56, 14), (4, 1)])
def test_stripes_are_quarters_of_other_widths(width, quarter):
    striped = Stripe(ONE, "stripe", levels=(1,))(torch.zeros(1, 3, 5, width), 1, torch.arange(1), 0)
    expected = [1.0] * quarter + [0.0] * (width - 2 * quarter) + [1.0] * quarter
    assert striped[0, 0, 0].tolist() == expected


def test_coordinates_are_pixels_at_28():
    assert mnist_coordinates(28).tolist() == list(range(28))
    assert mnist_cells(28).tolist() == list(range(28))
    assert mnist_cells(56).tolist() == [i // 2 for i in range(56)]


@pytest.mark.parametrize("ends", [(0, 3, 27, 20), (2.4, 20.2, 6.1, 12.7), (5, 9, 5, 30), (0, 26, 27, 0)])
def test_a_line_fades_with_the_vertical_distance(ends):
    points = torch.tensor(ends, dtype=torch.float64)
    np.testing.assert_allclose(line_overlay(points[:2], points[2:], 28, 28), line(*ends), atol=1e-12)


def test_dotted_lines_show_every_second_pair_of_columns():
    family = DottedLine(ONE, "dotted_line", levels=(1,))
    ends = torch.tensor([[3, 20], [26, 0], [0, 0]])
    result = family.apply(BLACK.expand(3, 1, 28, 28), 1, ends)
    for dots, (left, right) in zip(result[:, 0], ends.tolist(), strict=True):
        expected = line(0, left, 27, right)
        expected[:, [c for c in range(28) if c % 4 < 2]] = 0
        np.testing.assert_allclose(dots, expected, atol=1e-12)


@pytest.mark.parametrize("mode", ["faithful", "corrected"])
def test_zigzags_are_triangle_waves_along_every_line_that_is_drawn(mode):
    family = Zigzag(ONE, "zigzag", levels=(1,), mode=mode)
    drawn = torch.tensor([[start, rise] for start in (0, 13, 26) for rise in range(-5, 5)])
    result = family.apply(BLACK.expand(len(drawn), 1, 28, 28), 1, drawn)
    for picture, (start, rise) in zip(result[:, 0], drawn.tolist(), strict=True):
        np.testing.assert_allclose(picture, zigzag(start, rise, mode), atol=1e-12)


def test_the_ends_are_drawn_evenly_from_the_published_ranges():
    ends = DottedLine(ONE, "dotted_line", levels=(1,)).draw(1, torch.arange(2000), (1, 28, 28), 0)
    assert (ends.min(), ends.max()) == (0, 26)
    assert ends.double().mean(0).tolist() == pytest.approx([13, 13], abs=4 * math.sqrt(27**2 / 12 / 2000))
    starts, rises = Zigzag(ONE, "zigzag", levels=(1,)).draw(1, torch.arange(2000), (1, 28, 28), 0).unbind(-1)
    assert (starts.min(), starts.max()) == (0, 26)
    assert sorted(set(rises.tolist())) == list(range(-5, 5))


@pytest.mark.parametrize("family", [DottedLine(ONE, "dotted_line", levels=(1,)), Zigzag(ONE, "zigzag", levels=(1,))])
def test_lines_scale_with_the_image(family):
    drawn = family.draw(1, torch.arange(4), (1, 28, 28), 0)
    small = family.apply(torch.zeros(4, 1, 28, 28), 1, drawn)
    large = family.apply(torch.zeros(4, 3, 112, 112), 1, drawn)
    shrunk = large.unflatten(2, (28, 4)).unflatten(4, (28, 4)).mean((3, 5))[:, :1]
    assert torch.corrcoef(torch.stack([small.flatten(), shrunk.flatten()]))[0, 1] > 0.98


@pytest.mark.parametrize("family", [DottedLine(ONE, "dotted_line", levels=(1,)), Zigzag(ONE, "zigzag", levels=(1,))])
def test_lines_are_added_to_every_channel_and_clipped(family):
    clean = torch.rand(3, 3, 28, 28)
    drawn = family.draw(1, torch.arange(3), (3, 28, 28), 0)
    overlay = family.apply(torch.zeros(3, 1, 28, 28), 1, drawn)
    torch.testing.assert_close(family.apply(clean, 1, drawn), (clean + overlay).clamp(0, 1))
