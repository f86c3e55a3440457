"""Shears, turns, scalings and shifts against scikit-image's and scipy's warps."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage
from skimage.transform import AffineTransform, warp

from sextant.corruptions.shapes import Rotate, Scale, Shear, Translate, affine_warp

ANGLES = (0.2, 0.4, 0.6, 0.8, 1.0)
FACTORS = tuple(1 / s for s in (0.9, 0.8, 0.7, 0.6, 0.5))
INDICES = torch.arange(6)


def clean(shape=(1, 28, 28), count=6):
    return torch.rand(count, *shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


def about_the_centre(matrix, height, width):
    """The inverse map of skimage, (column, row), that keeps the centre."""
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    whole = np.eye(3)
    whole[:2, :2] = matrix
    whole[:2, 2] = centre - matrix @ centre
    return AffineTransform(matrix=whole)


def warped(image, matrix):
    """One image, by scikit-image."""
    transform = about_the_centre(np.asarray(matrix, float), *image.shape[-2:])
    return np.stack([warp(channel, inverse_map=transform, order=1) for channel in image.numpy()])


@given(st.integers(0, 99), st.tuples(st.integers(5, 20), st.integers(5, 20)))
def test_a_warp_is_that_of_scipy_inside_the_image(seed, size):
    generator = torch.Generator().manual_seed(seed)
    matrix = torch.randn(1, 2, 2, generator=generator, dtype=torch.float64)
    shift = torch.randn(1, 2, generator=generator, dtype=torch.float64)
    image = torch.rand(1, 2, *size, generator=generator, dtype=torch.float64)
    centre = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2])
    by_rows = matrix[0].flip(0, 1).numpy()  # scipy counts rows first
    offset = centre + shift[0].flip(0).numpy() - by_rows @ centre
    expected = [ndimage.affine_transform(c, by_rows, offset, order=1, mode="grid-constant") for c in image[0].numpy()]
    np.testing.assert_allclose(affine_warp(image, matrix, shift)[0], np.stack(expected), atol=1e-9)


@pytest.mark.parametrize("shape", [(1, 28, 28), (3, 20, 34)])
@pytest.mark.parametrize("level", [1, 2, 5])
def test_turns_and_shears_are_scikit_images(shape, level):
    images = clean(shape)
    for family in (
        Rotate(ANGLES, "rotate"),
        Shear(ANGLES, "shear", mode="faithful"),
        Shear(ANGLES, "shear", mode="corrected"),
    ):
        angles = family.draw(level, INDICES, shape, 0)
        assert angles.abs().tolist() == pytest.approx([ANGLES[level - 1]] * 6)
        result = family.apply(images, level, angles)
        for i, angle in enumerate(angles.tolist()):
            cosine, sine = math.cos(angle), math.sin(angle)
            matrix = {
                "rotate": [[cosine, -sine], [sine, cosine]],
                "faithful": [[1, -sine], [0, cosine]],
                "corrected": [[1, -math.tan(angle)], [0, 1]],
            }[getattr(family, "mode", "rotate")]
            np.testing.assert_allclose(result[i], warped(images[i], matrix), atol=1e-9)


@pytest.mark.parametrize("level", [1, 3, 5])
def test_scalings_are_scikit_images(level):
    images = clean()
    result = Scale(FACTORS, "scale")(images, level, INDICES, 0)
    for image, scaled in zip(images, result, strict=True):
        np.testing.assert_allclose(scaled, warped(image, np.eye(2) * FACTORS[level - 1]), atol=1e-9)


@pytest.mark.parametrize("level", [1, 3, 5])
def test_shifts_move_whole_pixels_and_bring_in_black(level):
    images = clean((3, 28, 28)).float()
    family = Translate((1, 2, 3, 4, 5), "translate")
    shifts = family.draw(level, INDICES, (3, 28, 28), 0)
    result = family.apply(images, level, shifts)
    for image, moved, (dx, dy) in zip(images, result, shifts.long().tolist(), strict=True):
        expected = torch.zeros_like(image)
        for y in range(28):
            for x in range(28):
                if 0 <= y + dy < 28 and 0 <= x + dx < 28:
                    expected[:, y, x] = image[:, y + dy, x + dx]
        assert torch.equal(moved, expected)


@pytest.mark.parametrize(
    ("family", "count"),
    [(Rotate(ANGLES, "rotate"), 1), (Shear(ANGLES, "shear"), 1), (Translate((1, 2), "translate"), 2)],
)
def test_both_directions_are_equally_likely_and_axes_independent(family, count):
    signs = family.draw(1, torch.arange(1000), (1, 28, 28), 0).sign().reshape(1000, count)
    assert signs.mean(0).abs().max() < 4 / math.sqrt(1000)
    assert abs(signs.prod(1).mean()) < 4 / math.sqrt(1000)


def test_nothing_moves_at_zero():
    images = clean((3, 9, 12))
    for family in (
        Rotate((0.0,), "rotate"),
        Shear((0.0,), "shear"),
        Scale((1.0,), "scale"),
        Translate((0,), "translate"),
    ):
        torch.testing.assert_close(family(images, 1, INDICES, 0), images)


def test_a_corrected_shear_keeps_the_area_and_the_published_one_does_not():
    square = torch.zeros(1, 1, 61, 61, dtype=torch.float64)
    square[..., 25:36, 25:36] = 1
    angle = torch.tensor([0.6], dtype=torch.float64)
    area = {
        mode: Shear((0.6,), "shear", mode=mode).apply(square, 1, angle).sum().item()
        for mode in ("faithful", "corrected")
    }
    assert area["corrected"] == pytest.approx(121, rel=0.02)
    assert area["faithful"] == pytest.approx(121 / math.cos(0.6), rel=0.02)
