import cv2
import numpy as np
import pytest
import torch
from scipy import ndimage

from sextant.corruptions import cifar10_c, imagenet_c
from sextant.corruptions.digital import ElasticDraw, ElasticTransform

SHAPES = pytest.mark.parametrize("shape", [(32, 32), (40, 56), (64, 28)], ids=str)


def slowly(image, corners, noise, row, mode, unit=1.0):
    """One image (h, w, c) with OpenCV and SciPy, as the authors compose them, with the draw given."""
    height, width = image.shape[:2]
    alpha, sigma, gamma = (min(height, width) * unit * value for value in row)
    centre = np.float32((height, width) if mode == "faithful" else (width, height)) // 2
    half = min(height, width) // 3
    before = np.float32([centre + half, [centre[0] + half, centre[1] - half], centre - half])
    matrix = cv2.getAffineTransform(before, before + (gamma * corners).astype(np.float32))
    image = cv2.warpAffine(image.astype(np.float32), matrix, (width, height), borderMode=cv2.BORDER_REFLECT_101)
    image = image.reshape(height, width, -1)  # OpenCV drops the axis of a single channel
    across, down = (ndimage.gaussian_filter(n, sigma, mode="reflect", truncate=3) * alpha for n in noise)
    rows, columns = np.mgrid[:height, :width]
    points = np.stack([rows + down, columns + across])
    channels = [ndimage.map_coordinates(image[..., c], points, order=1, mode="reflect") for c in range(image.shape[2])]
    return np.clip(np.stack(channels, -1), 0, 1)


def smooth_images(shape, channels=3):
    noise = np.random.default_rng(0).random((2, *shape, channels))
    smooth = ndimage.gaussian_filter(noise, (0, 2, 2, 0))
    return ((smooth - smooth.min()) / np.ptp(smooth)).astype(np.float32)


def both(corruption, severity, images, mode, unit=1.0):
    batch = torch.from_numpy(images).permute(0, 3, 1, 2).contiguous()
    drawn = corruption.draw(severity, torch.tensor([3, 8]), tuple(batch.shape[1:]), 0)
    found = corruption.apply(batch, severity, drawn).permute(0, 2, 3, 1).numpy()
    row = corruption.row(severity)
    expected = [
        slowly(image, corners.numpy(), noise.numpy(), row, mode, unit)
        for image, corners, noise in zip(images, *drawn, strict=True)
    ]
    return found, np.stack(expected)


@SHAPES
@pytest.mark.parametrize("severity", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_corrected_transform_is_that_of_opencv_and_scipy(shape, severity, channels):
    corruption = cifar10_c(["elastic_transform"], mode="corrected")["elastic_transform"]
    found, expected = both(corruption, severity, smooth_images(shape, channels), "corrected")
    # OpenCV before 4.11 samples at multiples of 1/32 of a pixel
    np.testing.assert_allclose(found, expected, rtol=0, atol=5e-5 if cv2.__version__ >= "4.11" else 0.02)


@SHAPES
@pytest.mark.parametrize("build", [cifar10_c, imagenet_c])
@pytest.mark.parametrize("severity", [1, 3, 5])
def test_a_faithful_transform_is_within_a_sixtyfourth_of_a_pixel_of_it(shape, build, severity):
    corruption = build(["elastic_transform"])["elastic_transform"]
    images = smooth_images(shape)
    found, expected = both(corruption, severity, images, "faithful", corruption.unit)
    steepest = max(np.abs(np.diff(images, axis=axis)).max() for axis in (1, 2))
    assert 1e-6 < np.abs(found - expected).max() < 2 * steepest / 64 + 1e-4


def test_nothing_moves_where_nothing_is_drawn():
    corruption = ElasticTransform([(0.1, 0.03, 0.05)], "elastic")
    images = torch.rand(2, 3, 31, 24)
    still = ElasticDraw(torch.zeros(2, 3, 2, dtype=torch.float64), torch.zeros(2, 2, 31, 24))
    torch.testing.assert_close(corruption.apply(images, 1, still), images, rtol=0, atol=1e-6)


def test_corners_moved_alike_shift_the_image():
    images = torch.rand(1, 1, 24, 24)
    drawn = ElasticDraw(torch.tensor([[[0.5, -0.25]] * 3], dtype=torch.float64), torch.zeros(1, 2, 24, 24))
    shifted = ElasticTransform([(0.0, 0.0, 8 / 24)], "elastic").apply(images, 1, drawn)  # 4 to the right, 2 up
    torch.testing.assert_close(shifted[..., :-2, 4:], images[..., 2:, :-4], rtol=0, atol=1e-6)


def test_imagenet_c_takes_244_pixels_for_224_in_faithful_mode_alone():
    assert imagenet_c(["elastic_transform"])["elastic_transform"].unit == 244 / 224
    assert imagenet_c(["elastic_transform"], mode="corrected")["elastic_transform"].unit == 1


def test_images_too_small_for_a_square_are_refused():
    corruption = cifar10_c(["elastic_transform"])["elastic_transform"]
    with pytest.raises(ValueError, match="at least 3x3 pixels, not 2x9"):
        corruption(torch.rand(1, 1, 2, 9), 1, torch.arange(1), 0)
