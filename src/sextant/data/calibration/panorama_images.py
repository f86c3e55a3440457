"""Decoding of panorama files of any kind into upright RGB bytes of one size."""

import warnings
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image, ImageOps

from sextant.data.image_files import eight_bits

#: formats that are decoded; none whose decoder runs another program, as that of EPS does
FORMATS = ("JPEG", "PNG", "TIFF", "BMP", "WEBP", "PPM", "AVIF")
#: width over height may differ from 2 by this share
TOLERANCE = 0.01
SMALLEST_HEIGHT = 32
ORIENTATION = 0x0112
TURNED = (5, 6, 7, 8)  # orientations that exchange width and height


class UnfitImageError(Exception):
    """The file is not a panorama; the message says why, without the file's name."""


def decode_panorama(path: Path, height: int) -> UInt8[ndarray, "height 2*height 3"]:
    """A panorama, turned upright by its EXIF orientation and scaled to ``height`` rows.

    Grey, palette, CMYK and 16-bit images become 8-bit RGB; transparent pixels become black. JPEG files are decoded at a
    half, a quarter or an eighth of their size where that is enough.

    Raises:
        UnfitImageError: it cannot be decoded, has too many pixels, or is not twice as wide as high.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns of sizes that are usual for panoramas; its limit holds
            Image.init()  # until then Pillow knows only the commonest formats
            with Image.open(path, formats=[name for name in FORMATS if name in Image.OPEN]) as image:
                _check_shape(image)
                image.draft("RGB", (2 * height, height))
                upright = eight_bits(ImageOps.exif_transpose(image)).convert("RGB")
                return np.asarray(upright.resize((2 * height, height), Image.Resampling.LANCZOS, reducing_gap=3.0))
    except UnfitImageError:
        raise
    except Exception as error:  # Pillow's decoders raise whatever they come across in a damaged file
        size = path.stat().st_size if path.is_file() else 0
        reason = "is empty" if size == 0 else f"cannot be decoded ({size:,} bytes): {str(error).split(chr(10))[0]}"
        raise UnfitImageError(reason) from None


def _check_shape(image: Image.Image) -> None:
    width, height = image.size
    if image.getexif().get(ORIENTATION) in TURNED:
        width, height = height, width
    if abs(width / (2 * height) - 1) > TOLERANCE:
        raise UnfitImageError(f"is {width} x {height} pixels, a full panorama is twice as wide as high")
    if height < SMALLEST_HEIGHT:
        raise UnfitImageError(f"is {width} x {height} pixels, at least {SMALLEST_HEIGHT} rows are needed")
