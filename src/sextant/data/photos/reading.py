"""Decoding photos of many formats, within bounded memory."""

import math
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy import ndarray
from PIL import Image

from sextant.data.metadata import exif_of
from sextant.data.photos.exif import apple_gravity, exif_focal_px, exif_numbers, was_cropped
from sextant.data.photos.view import Photo
from sextant.data.picture_files import open_picture, why_unreadable
from sextant.data.pixel_values import WhiteLevels, eight_bits, rgb_bytes
from sextant.data.upright import TURN, exif_orientation
from sextant.errors import UserError
from sextant.user_files import absent

SMALLEST_SIDE = 32
LARGEST_DECODED = 64_000_000  # pixels that are kept
LARGEST_SIDE = 32_000  # pixels that are kept: cv2.remap uses 16-bit coordinates
LARGEST_FILE = 512_000_000  # pixels of a JPEG, which can be decoded at 1/2, 1/4 or 1/8
END_OF_CODESTREAM = b"\xff\xd9"  # of JPEG 2000, whose data never hold it
LARGEST_WHOLE = 256_000_000  # pixels of formats that are decoded whole: 1 GiB at Pillow's four bytes per pixel
_pillow = threading.Lock()  # its pixel limit is a global variable


def read_photo(path: Path, levels: WhiteLevels | None = None) -> Photo:
    """Decode a photo as upright 8-bit RGB; of a file with several pictures, the first.

    Grey becomes three equal channels. More than 8 bits become 8 as :mod:`~sextant.data.pixel_values` says. CMYK and
    palettes become RGB; transparent pixels become mid grey (128). Colour profiles are not applied.

    Args:
        path: of the file.
        levels: white levels of the photos that it belongs to; None for those of its folder.

    Raises:
        UserError: the file is missing, empty, truncated, not a picture in a known format, smaller than 32 pixels per
            side, or larger than 512 megapixels (JPEG) or 256 (formats that can only be decoded whole).
    """
    if path.is_dir():
        raise UserError(f"{path} is a folder; a photo is a file", "Give the file of a photo.")
    if not path.is_file():
        raise UserError(absent(path))
    size = path.stat().st_size
    if size == 0:
        raise UserError(f"{path} is empty (0 bytes)", "Copy the photo again.")
    try:
        with without_pillow_limit(), open_picture(path) as image:
            return _decode(image, path, levels)
    except (UserError, MemoryError):
        raise
    except Exception as error:  # the decoders raise almost anything on broken files
        raise UserError(f"{path} {why_unreadable(path, error)}", "Give another file.") from None


def photo_of_array(image: ndarray, name: str) -> Photo:
    """Wrap a photo that was decoded elsewhere.

    Args:
        image: upright RGB bytes, ``(h, w, 3)``.
        name: of the photo, for messages.

    Raises:
        UserError: it is not such an array, or smaller than 32 pixels per side.
    """
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        shape = "x".join(map(str, image.shape))
        raise UserError(f"{name} is {image.dtype} {shape}; a photo is uint8, height x width x 3", "Give its file.")
    height, width = image.shape[:2]
    _check_smallest(width, height, name)
    return Photo(image, width, height, 1, None)


@contextmanager
def without_pillow_limit() -> Iterator[None]:
    """Lift Pillow's pixel limit, which warns or raises long before ours, and its warnings about odd metadata."""
    with _pillow, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            yield
        finally:
            Image.MAX_IMAGE_PIXELS = limit


def _decode(image: Image.Image, path: Path, levels: WhiteLevels | None) -> Photo:
    width, height = image.size
    _check_size(width, height, image.format or "", path)
    factor = 1
    while (width // factor) * (height // factor) > LARGEST_DECODED or max(width, height) / factor > LARGEST_SIDE:
        factor += 1
    exif = exif_numbers(image)
    orientation = exif_orientation(image)
    focal, cropped = exif_focal_px(exif, width, height), was_cropped(exif, width, height)
    gravity = None if cropped else apple_gravity(exif_of(image), width, height, orientation)
    if factor > 1:
        image.draft("RGB", (width // factor, height // factor))  # a JPEG at 1/2, 1/4 or 1/8; others ignore it
    eight = eight_bits(image, path, levels)
    eight.load()
    if image.format == "JPEG2000" and END_OF_CODESTREAM not in path.read_bytes():
        raise ValueError("it is truncated: its codestream has no end")  # OpenJPEG fills what is missing with grey
    turn = exif_orientation(eight)  # Pillow has turned a TIFF by now, and its size was the upright one from the start
    rgb = rgb_bytes(eight, max(1, math.ceil(factor * eight.width / width - 0.01)))
    if turn in TURN:
        rgb = rgb.transpose(TURN[turn])
    if turn >= 5:
        width, height = height, width
    return Photo(np.asarray(rgb), width, height, orientation, focal, cropped, gravity)


def _check_smallest(width: int, height: int, name: object) -> None:
    if min(width, height) < SMALLEST_SIDE:
        raise UserError(
            f"{name} has {width}x{height} pixels; the shorter side must have at least {SMALLEST_SIDE}",
            "Give a larger version of the photo.",
        )


def _check_size(width: int, height: int, kind: str, path: Path) -> None:
    _check_smallest(width, height, path)
    limit = LARGEST_FILE if kind in ("JPEG", "MPO") else LARGEST_WHOLE
    if width * height > limit:
        raise UserError(
            f"{path} has {width}x{height} pixels ({width * height / 1e6:.0f} megapixels); "
            f"{kind} is decoded up to {limit / 1e6:.0f}",
            "Scale the photo down"
            + ("." if limit == LARGEST_FILE else ", or save it as JPEG, which needs less memory."),
        )
