"""Pictures and metadata for tests of photos."""

import numpy as np
from PIL import Image

from sextant.data.photos import exif as exif_tags

ORIENTATION, EXIF_BLOCK = 0x0112, 0x8769
#: for each EXIF orientation, what turns an array of stored pixels upright
UPRIGHT = {
    1: lambda a: a,
    2: lambda a: a[:, ::-1],
    3: lambda a: a[::-1, ::-1],
    4: lambda a: a[::-1],
    5: lambda a: a.swapaxes(0, 1),
    6: lambda a: np.rot90(a, -1),
    7: lambda a: a.swapaxes(0, 1)[::-1, ::-1],
    8: lambda a: np.rot90(a, 1),
}


def scene(width=96, height=64, channels=3):
    """Smooth, and different in each corner and channel."""
    x, y = np.meshgrid(np.linspace(0, 1, width), np.linspace(0, 1, height))
    planes = [60 + 150 * x, 40 + 180 * y, 220 - 90 * x - 90 * y, np.full_like(x, 255)]
    return np.stack(planes[:channels], -1).round().astype(np.uint8)


def save(path, image, **options):
    (image if isinstance(image, Image.Image) else Image.fromarray(image)).save(path, **options)
    return path


def exif_with(orientation=None, **block):
    exif = Image.Exif()
    if orientation:
        exif[ORIENTATION] = orientation
    exif.get_ifd(EXIF_BLOCK).update({getattr(exif_tags, name): value for name, value in block.items()})
    return exif
