"""Brightness, contrast and saturation against conversions by scikit-image."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from skimage.color import hsv2rgb, rgb2hsv

from sextant.corruptions import cifar10_c, imagenet_c

SETS = [cifar10_c, imagenet_c]
pictures = arrays(np.uint8, (6, 5, 3)).map(lambda a: a / 255)
severities = st.integers(1, 5)
sets = st.sampled_from(SETS)


def corrupted(build, name, severity, picture, mode="faithful"):
    images = torch.from_numpy(picture).permute(2, 0, 1)[None]
    return build([name], mode=mode)[name](images, severity, torch.arange(1), 0)[0].permute(1, 2, 0).numpy()


@given(pictures, severities, sets)
def test_brightness_is_a_shift_of_the_value(picture, severity, build):
    hsv = rgb2hsv(picture)
    hsv[..., 2] = np.clip(hsv[..., 2] + build(["brightness"])["brightness"].row(severity), 0, 1)
    np.testing.assert_allclose(corrupted(build, "brightness", severity, picture), hsv2rgb(hsv), rtol=0, atol=1e-9)


@given(pictures, severities, sets)
def test_faithful_saturation_is_that_of_the_authors(picture, severity, build):
    factor, shift = build(["saturate"])["saturate"].row(severity)
    hsv = rgb2hsv(picture)
    hsv[..., 1] = np.clip(hsv[..., 1] * factor + shift, 0, 1)
    np.testing.assert_allclose(corrupted(build, "saturate", severity, picture), hsv2rgb(hsv), rtol=0, atol=1e-9)


def test_grey_pixels_turn_reddish_in_faithful_mode_and_stay_grey_in_corrected_mode():
    grey = np.full((4, 4, 3), 0.6)
    np.testing.assert_allclose(corrupted(cifar10_c, "saturate", 5, grey)[0, 0], [0.6, 0.48, 0.48], atol=1e-9)
    np.testing.assert_array_equal(corrupted(cifar10_c, "saturate", 5, grey, "corrected"), grey)


@given(pictures)
def test_modes_differ_in_grey_pixels_alone(picture):
    coloured = picture.max(-1) > picture.min(-1)
    faithful, corrected = (corrupted(cifar10_c, "saturate", 5, picture, mode) for mode in ("faithful", "corrected"))
    np.testing.assert_array_equal(faithful[coloured], corrected[coloured])


@given(pictures, severities, sets)
def test_contrast_draws_every_channel_to_its_mean(picture, severity, build):
    factor = build(["contrast"])["contrast"].row(severity)
    mean = picture.mean((0, 1))
    expected = np.clip((picture - mean) * factor + mean, 0, 1)
    np.testing.assert_allclose(corrupted(build, "contrast", severity, picture), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("build", SETS)
def test_a_grey_image_is_brightened_by_addition_and_has_no_saturation(build):
    picture = np.random.default_rng(0).random((8, 8, 1))
    shift = build(["brightness"])["brightness"].row(3)
    np.testing.assert_allclose(corrupted(build, "brightness", 3, picture), np.clip(picture + shift, 0, 1), atol=1e-12)
    np.testing.assert_array_equal(corrupted(build, "saturate", 3, picture), picture)


@pytest.mark.parametrize("name", ["brightness", "saturate"])
@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_black_and_nearly_black_pixels_have_a_colour_in_half_precision_as_in_single(name, dtype):
    images = torch.tensor([0.0, 1e-7, 6e-8, 0.5]).repeat(3).view(1, 3, 1, 4).to(dtype)
    for level in (1, 3, 5):
        corruption = cifar10_c([name])[name]
        expected = corruption(images.float(), level, 0, 0)
        torch.testing.assert_close(corruption(images, level, 0, 0).float(), expected, rtol=1e-2, atol=1e-6)
