from io import BytesIO

import numpy as np
import pytest
import torch
from PIL import Image

from sextant.corruptions import cifar10_c, imagenet_c, to_bytes
from sextant.errors import UserError


@pytest.mark.parametrize("build", [cifar10_c, imagenet_c])
@pytest.mark.parametrize("severity", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("shape", [(32, 32, 3), (28, 28, 1), (45, 31, 3)], ids=str)
def test_it_is_pillows_jpeg(build, severity, shape):
    pixels = np.random.default_rng(0).integers(0, 256, (3, *shape), np.uint8)
    corruption = build(["jpeg_compression"])["jpeg_compression"]
    images = torch.from_numpy(pixels).permute(0, 3, 1, 2) / 255
    found = to_bytes(corruption(images, severity, torch.arange(3), 0)).permute(0, 2, 3, 1).numpy()
    for picture, compressed in zip(pixels, found, strict=True):
        file = BytesIO()
        Image.fromarray(picture.squeeze()).save(file, "JPEG", quality=corruption.row(severity))
        np.testing.assert_array_equal(compressed, np.asarray(Image.open(file)).reshape(shape))


def test_images_of_other_channels_are_refused():
    compression = cifar10_c(["jpeg_compression"])["jpeg_compression"]
    with pytest.raises(UserError, match="1 or 3 channels"):
        compression(torch.rand(1, 2, 8, 8), 1, torch.arange(1), 0)
    with pytest.raises(ValueError, match="1 or 3 channels, not 2"):
        compression.apply(torch.rand(1, 2, 8, 8), 1, None)
