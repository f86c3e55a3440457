"""Image files of any kind as bytes of one size."""

import re
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from sextant.data.picture_files import UnreadableImageError, open_picture, why_unreadable
from sextant.data.pixel_values import WhiteLevels, eight_bits, without_alpha
from sextant.data.upright import upright

SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff", ".ppm", ".pgm", ".avif", ".gif", ".jp2")
SMALLEST_SIDE = 4


def require_sides(image: Image.Image) -> None:
    """Raise an ``UnreadableImageError`` for a picture with too few pixels to show anything."""
    if min(image.size) < SMALLEST_SIDE:
        size = f"{image.width}x{image.height}"
        raise UnreadableImageError(f"has {size} pixels; the shorter side must have at least {SMALLEST_SIDE}")


def natural_key(name: str) -> tuple[list[tuple[int, str]], str]:
    """Sort key by which numbers in names are compared as numbers; different names have different keys."""
    parts = re.split(r"(\d+)", name)
    return [(int(part), "") if k % 2 else (-1, part) for k, part in enumerate(parts)], name


def decode_image(
    path: Path, height: int, width: int, channels: int, levels: WhiteLevels | None = None
) -> UInt8[ndarray, "height width channels"]:
    """An image, turned upright by its EXIF orientation and stretched to ``height`` x ``width`` pixels.

    An image that already has this size keeps its values. More than 8 bits become 8 by the white level of ``levels``, so
    that frames of a drive stay comparable; transparent pixels become black.

    Args:
        path: of the file.
        height: rows.
        width: columns.
        channels: 3 for RGB, 1 for grey.
        levels: of the images that it belongs to; None for those of its folder.

    Raises:
        UnreadableImageError: it cannot be decoded.
    """
    try:
        with open_picture(path) as image:
            require_sides(image)
            if max(image.size) > 4 * max(height, width):
                image.draft("RGB", (2 * max(height, width),) * 2)  # a JPEG at 1/2, 1/4 or 1/8; others ignore it
            return picture_bytes(image, height, width, channels, path, levels)
    except Exception as error:  # Pillow's decoders raise errors of any kind for a damaged file
        raise UnreadableImageError(why_unreadable(path, error)) from None


def picture_bytes(
    image: Image.Image,
    height: int,
    width: int,
    channels: int,
    path: Path | None = None,
    levels: WhiteLevels | None = None,
) -> UInt8[ndarray, "height width channels"]:
    """An open picture, decoded as in :func:`decode_image`.

    Raises:
        ValueError: the white level of its values is unknown.
    """
    picture = without_alpha(upright(eight_bits(image, path, levels))).convert("RGB" if channels == 3 else "L")
    if picture.size != (width, height):
        picture = picture.resize((width, height), Image.Resampling.LANCZOS, reducing_gap=3.0)
    return np.asarray(picture).reshape(height, width, channels)
