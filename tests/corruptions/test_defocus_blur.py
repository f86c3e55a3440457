import cv2
import numpy as np
import pytest
import torch

from sextant.corruptions import cifar10_c, imagenet_c
from sextant.corruptions.blur import DefocusBlur, disk_kernel

ROWS = [row for build in (cifar10_c, imagenet_c) for row in build(["defocus_blur"])["defocus_blur"].table]


def published_kernel(radius, alias):
    line = np.arange(-8, 9) if radius <= 8 else np.arange(-radius, radius + 1)
    disk = np.float32(line[:, None] ** 2 + line**2 <= radius**2)
    return cv2.GaussianBlur(disk / disk.sum(), (3, 3) if radius <= 8 else (5, 5), sigmaX=alias)


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_the_kernel_is_opencvs_blur_of_a_disk(row):
    found, expected = disk_kernel(*row).numpy(), published_kernel(*row)
    margin = (len(expected) - len(found)) // 2
    np.testing.assert_allclose(np.pad(found, margin), expected, rtol=0, atol=1e-7)


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_the_kernel_sums_to_one_unless_the_disk_touches_its_grid(row):
    gain = {8: 1.013, 10: 1.011}.get(row[0], 1.0)
    assert disk_kernel(*row).sum().item() == pytest.approx(gain, abs=5e-4 if gain > 1 else 1e-12)


@pytest.mark.parametrize("row", ROWS, ids=str)
@pytest.mark.parametrize("size", [(32, 32), (20, 45)])
def test_it_is_opencvs_filter(row, size):
    images = np.random.default_rng(0).random((2, 3, *size))
    found = DefocusBlur([row], "defocus")(torch.from_numpy(images), 1, torch.arange(2), 0)
    kernel = published_kernel(*row).astype(np.float64)
    for image, blurred in zip(images.transpose(0, 2, 3, 1), found, strict=True):
        expected = np.clip(cv2.filter2D(np.ascontiguousarray(image), -1, kernel), 0, 1)
        np.testing.assert_allclose(blurred.permute(1, 2, 0), expected, rtol=0, atol=2e-6)


def test_a_corrected_blur_does_not_brighten():
    grey = torch.full((1, 3, 40, 40), 0.5, dtype=torch.float64)
    for mode, mean in (("faithful", 0.5 * 1.012975), ("corrected", 0.5)):
        blurred = imagenet_c(["defocus_blur"], mode=mode)["defocus_blur"](grey, 4, torch.arange(1), 0)
        torch.testing.assert_close(blurred, torch.full_like(blurred, mean), rtol=0, atol=1e-6)
