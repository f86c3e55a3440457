import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.corruptions import cifar10_c, eight_bit
from sextant.corruptions.blur import MotionBlur
from sextant.corruptions.filtering import _sum_of_gathers, motion_blur, motion_offsets, motion_weights, shifted_sum


def slowly(image, radius, sigma, degrees):
    """Pixel by pixel, from the definition of ImageMagick's ``MotionBlurImage``."""
    height, width = image.shape[1:]
    count = 2 * math.ceil(radius) + 1
    weights = [math.exp(-i * i / (2 * sigma * sigma)) for i in range(count)]
    result = np.zeros_like(image)
    for y in range(height):
        for x in range(width):
            for i, weight in enumerate(weights):
                column = x + math.ceil(i * math.cos(math.radians(degrees)) - 0.5)
                row = y + math.ceil(i * math.sin(math.radians(degrees)) - 0.5)
                near = image[:, min(max(row, 0), height - 1), min(max(column, 0), width - 1)]
                result[:, y, x] += weight / sum(weights) * near
    return result


@given(st.floats(-180, 180), st.sampled_from([(6, 1), (9, 2.5), (20, 15), (2.5, 4)]))
def test_it_is_a_one_sided_gaussian_along_a_line(degrees, row):
    images = torch.from_numpy(np.random.default_rng(0).random((1, 2, 9, 12)))
    found = motion_blur(images, *row, torch.tensor([degrees], dtype=torch.float64))
    np.testing.assert_allclose(found[0], slowly(images[0].numpy(), *row, degrees), rtol=0, atol=1e-12)


def test_the_corruption_rounds_to_the_nearest_of_256_values():
    images, indices = torch.rand(3, 3, 16, 16), torch.arange(3)
    corruption = cifar10_c(["motion_blur"])["motion_blur"]
    drawn = corruption.draw(4, indices, (3, 16, 16), 0)
    expected = eight_bit(motion_blur(images, 8, 2, drawn), "corrected")
    assert torch.equal(corruption.apply(images, 4, drawn), expected)


def test_angles_are_uniform_within_45_degrees():
    degrees = MotionBlur([(6, 1)], "motion").draw(1, torch.arange(4000), (3, 8, 8), 0)
    assert degrees.abs().max() < 45
    assert abs(degrees.mean()) < 4 * 26 / math.sqrt(4000)
    assert degrees.std() == pytest.approx(90 / math.sqrt(12), rel=0.02)


def test_weights_sum_to_one_and_fall_from_the_pixel_outward():
    weights = motion_weights(8, 3)
    assert len(weights) == 17
    assert weights.sum().item() == pytest.approx(1)
    assert (weights.diff() < 0).all()


def test_a_line_to_the_right_and_one_downward():
    offsets = motion_offsets(torch.tensor([0.0, 90.0]), 4)
    assert offsets[0].tolist() == [[0, 0], [1, 0], [2, 0], [3, 0]]
    assert offsets[1].tolist() == [[0, 0], [0, 1], [0, 2], [0, 3]]


@given(st.integers(1, 8), st.integers(1, 8), st.sampled_from(["nearest", "reflect", "mirror"]), st.booleans())
def test_the_paths_of_all_devices_agree(height, width, border, shared):
    rng = torch.Generator().manual_seed(0)
    images = torch.rand(3, 2, height, width, generator=rng, dtype=torch.float64)
    shifts = torch.randint(-11, 12, (1 if shared else 3, 5, 2), generator=rng)
    weights = torch.rand(5, generator=rng, dtype=torch.float64)
    found, other = shifted_sum(images, weights, shifts, border), _sum_of_gathers(images, weights, shifts, border)
    torch.testing.assert_close(found, other, rtol=0, atol=1e-13)
