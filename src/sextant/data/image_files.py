"""Image files of any kind as bytes of one size."""

import mimetypes
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from sextant.data.upright import upright

SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff", ".ppm", ".pgm", ".avif")
#: what is decoded; no format whose decoder runs another program (EPS) is among them
FORMATS = ("JPEG", "MPO", "PNG", "TIFF", "BMP", "WEBP", "PPM", "AVIF", "GIF", "JPEG2000")
#: pictures as sensors deliver them
RAW = (".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2")
SMALLEST_SIDE = 4


class UnreadableImageError(Exception):
    """A file that cannot be decoded; says why, without its name."""


def not_decoded(path: Path) -> str | None:
    """Why a file of a kind that is well known is no picture here, by its name; None where the name tells nothing."""
    if path.suffix.lower() in (".heic", ".heif", *RAW):
        return f"is {path.suffix}, which is not decoded here: save it as JPEG"
    if (mimetypes.guess_type(path.name)[0] or "").startswith("video/"):
        return "is a video, no photo: save frames of it as photos, or give it to sextant walk or sextant inspect"
    return None


def require_sides(image: Image.Image) -> None:
    """Raise a ``ValueError`` for a picture of so few pixels that it shows nothing, whatever it is enlarged to."""
    if min(image.size) < SMALLEST_SIDE:
        raise ValueError(f"{image.width}x{image.height} pixels, the shorter side needs {SMALLEST_SIDE}")


def images_below(folder: Path) -> list[Path]:
    """All image files below a folder, hidden ones left out; ``image2`` comes before ``image10``."""
    return sorted(image_paths(folder), key=lambda path: natural_key(path.relative_to(folder).as_posix()))


def image_paths(folder: Path) -> Iterator[Path]:
    """:func:`images_below`, in no order."""
    found = (path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file())
    return (path for path in found if not any(part.startswith(".") for part in path.relative_to(folder).parts))


def natural_key(name: str) -> tuple[list[tuple[int, str]], str]:
    """What names are sorted by so that numbers in them count as numbers; names that differ have different keys."""
    parts = re.split(r"(\d+)", name)
    return [(int(part), "") if k % 2 else (-1, part) for k, part in enumerate(parts)], name


def decode_image(path: Path, height: int, width: int, channels: int) -> UInt8[ndarray, "height width channels"]:
    """An image, turned upright by its EXIF orientation and stretched to ``height`` x ``width`` pixels.

    One that has this size already keeps its values. Of 16 bits the upper eight are kept, so that frames of a ride stay
    comparable; what is transparent becomes black.

    Args:
        path: of the file.
        height: rows.
        width: columns.
        channels: 3 for RGB, 1 for grey.

    Raises:
        UnreadableImageError: it cannot be decoded.
    """
    try:
        Image.init()  # until then Pillow knows the commonest formats alone
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
    """A picture that is open, as :func:`decode_image` does it.

    Raises:
        ValueError: the white level of its values is unknown.
    """
    picture = eight_bits(upright(image)).convert("RGB" if channels == 3 else "L")
    if picture.size != (width, height):
        picture = picture.resize((width, height), Image.Resampling.LANCZOS, reducing_gap=3.0)
    return np.asarray(picture).reshape(height, width, channels)


def eight_bits(image: Image.Image) -> Image.Image:
    """A picture of 8 bits, without transparency: black shows through.

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
