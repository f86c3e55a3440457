import numpy as np
import pytest
import torch
from PIL import Image

from sextant.corruptions import cifar10_c, imagenet_c, to_bytes


def noise(height, width, channels=3):
    return np.random.default_rng(0).integers(0, 256, (height, width, channels), np.uint8)


def as_batch(pixels):
    return torch.from_numpy(pixels).permute(2, 0, 1)[None]


@pytest.mark.parametrize("build", [cifar10_c, imagenet_c])
@pytest.mark.parametrize("severity", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("shape", [(32, 32, 3), (28, 28, 1), (224, 224, 3), (50, 71, 3)], ids=str)
def test_it_is_pillows_resize_down_and_up(build, severity, shape):
    pixels, corruption = noise(*shape), build(["pixelate"])["pixelate"]
    height, width, factor = *shape[:2], corruption.row(severity)
    picture = Image.fromarray(pixels[..., 0] if shape[2] == 1 else pixels)
    small = picture.resize((int(width * factor), int(height * factor)), Image.Resampling.BOX)
    expected = np.asarray(small.resize((width, height), Image.Resampling.BOX)).reshape(shape)
    for dtype in (torch.float32, torch.float64):
        images = (as_batch(pixels) / 255).to(dtype)
        found = corruption(images, severity, torch.arange(1), 0)
        for mode in ("faithful", "corrected"):
            np.testing.assert_array_equal(to_bytes(found, mode)[0].permute(1, 2, 0).numpy(), expected)
