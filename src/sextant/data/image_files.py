"""Image files of any kind as bytes of one size."""

import mimetypes
import re
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from sextant.data.upright import upright

SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff", ".ppm", ".pgm", ".avif", ".gif", ".jp2")
#: formats that are decoded; none whose decoder runs another program, as that of EPS does
FORMATS = ("JPEG", "MPO", "PNG", "TIFF", "BMP", "WEBP", "PPM", "AVIF", "GIF", "JPEG2000")
#: raw sensor data
RAW = (".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2")
SMALLEST_SIDE = 4


class UnreadableImageError(Exception):
    """The file cannot be decoded; the message says why, without the file's name."""


def not_decoded(path: Path) -> str | None:
    """Why a file of a well-known kind is not read as a picture, judged by its name; None if the name does not tell."""
    if path.suffix.lower() in (".heic", ".heif", *RAW):
        return f"is {path.suffix}, which is not decoded here: save it as JPEG"
    if (mimetypes.guess_type(path.name)[0] or "").startswith("video/"):
        return "is a video, no photo: save frames of it as photos, or give it to sextant walk or sextant inspect"
    return None


def require_sides(image: Image.Image) -> None:
    """Raise a ``ValueError`` for a picture of so few pixels that it shows nothing, however much it is enlarged."""
    if min(image.size) < SMALLEST_SIDE:
        raise ValueError(f"{image.width}x{image.height} pixels, the shorter side needs {SMALLEST_SIDE}")


def natural_key(name: str) -> tuple[list[tuple[int, str]], str]:
    """Sort key by which numbers in names are compared as numbers; different names have different keys."""
    parts = re.split(r"(\d+)", name)
    return [(int(part), "") if k % 2 else (-1, part) for k, part in enumerate(parts)], name


def decode_image(path: Path, height: int, width: int, channels: int) -> UInt8[ndarray, "height width channels"]:
    """An image, turned upright by its EXIF orientation and stretched to ``height`` x ``width`` pixels.

    An image that already has this size keeps its values. Of 16 bits the upper eight are kept, so that frames of a drive
    stay comparable; transparent pixels become black.

    Args:
        path: of the file.
        height: rows.
        width: columns.
        channels: 3 for RGB, 1 for grey.

    Raises:
        UnreadableImageError: it cannot be decoded.
    """
    try:
        Image.init()  # until then Pillow knows only the commonest formats
        with Image.open(path, formats=[name for name in FORMATS if name in Image.OPEN]) as image:
            require_sides(image)
            if max(image.size) > 4 * max(height, width):
                image.draft("RGB", (2 * max(height, width),) * 2)  # a JPEG at 1/2, 1/4 or 1/8; others ignore it
            return picture_bytes(image, height, width, channels)
    except Exception as error:  # Pillow's decoders raise whatever they come across in a damaged file
        size = path.stat().st_size if path.is_file() else 0
        reason = f"cannot be decoded ({size:,} bytes): {str(error).split(chr(10))[0]}"
        raise UnreadableImageError("is empty" if size == 0 else not_decoded(path) or reason) from None


def picture_bytes(
    image: Image.Image, height: int, width: int, channels: int
) -> UInt8[ndarray, "height width channels"]:
    """An open picture, decoded as in :func:`decode_image`.

    Raises:
        ValueError: the white level of its values is unknown.
    """
    picture = eight_bits(upright(image)).convert("RGB" if channels == 3 else "L")
    if picture.size != (width, height):
        picture = picture.resize((width, height), Image.Resampling.LANCZOS, reducing_gap=3.0)
    return np.asarray(picture).reshape(height, width, channels)


def eight_bits(image: Image.Image) -> Image.Image:
    """An 8-bit picture without transparency, composited on black.

    Raises:
        ValueError: the white level of its values is unknown.
    """
    if image.mode.startswith("I"):  # 16 bits: Pillow would clip them to 255
        return Image.fromarray((np.asarray(image).clip(0, 65535) >> 8).astype(np.uint8))
    if image.mode == "F":
        raise ValueError("floating-point values whose white level is unknown: convert it to 8 or 16 bits")
    if image.mode in ("LA", "PA", "La", "RGBa", "RGBA") or "transparency" in image.info:
        layer = image.convert("RGBA")
        return Image.alpha_composite(Image.new("RGBA", layer.size, (0, 0, 0, 255)), layer)
    return image
