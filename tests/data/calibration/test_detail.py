import numpy as np
import pytest
from data.photos.pictures import scene

from sextant.chapters.calibration.data.batches import with_detail

NUMBERS = np.arange(24)


@pytest.fixture
def images():
    rng = np.random.default_rng(0)
    noisy = scene(64, 64).astype(float) + rng.normal(0, 25, (24, 64, 64, 3))
    return np.ascontiguousarray(noisy.clip(0, 255).astype(np.uint8).transpose(0, 3, 1, 2))


def sharpness(images):
    return np.abs(np.diff(images.astype(float), axis=-1)).mean((1, 2, 3))


def test_it_is_a_function_of_seed_and_number(images):
    whole = with_detail(images, (24, 128), NUMBERS, 3)
    np.testing.assert_array_equal(with_detail(images[5:9], (24, 128), NUMBERS[5:9], 3), whole[5:9])
    assert (with_detail(images, (24, 128), NUMBERS, 4) != whole).any((1, 2, 3)).mean() > 0.8


def test_fewer_lines_leave_less_detail(images):
    coarse, fine = (sharpness(with_detail(images, (lines, lines + 1), NUMBERS, 0)).mean() for lines in (16, 60))
    assert coarse < 0.5 * fine


def test_what_a_crop_gets_differs_from_crop_to_crop(images):
    same = np.repeat(images[:1], 24, 0)
    drawn = sharpness(with_detail(same, (16, 128), NUMBERS, 0))
    assert drawn.max() > 3 * drawn.min()


def test_colours_and_brightness_stay(images):
    drawn = with_detail(images, (24, 128), NUMBERS, 0)
    np.testing.assert_allclose(drawn.mean((2, 3)), images.mean((2, 3)), atol=3)
