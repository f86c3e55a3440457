"""Decoding of panorama files of any kind into upright RGB bytes of one size."""

import warnings
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from sextant.data.picture_files import open_picture, why_unreadable
from sextant.data.pixel_values import WhiteLevels, eight_bits, without_alpha
from sextant.data.upright import upright, upright_size

#: width over height may differ from 2 by this share
TOLERANCE = 0.01
SMALLEST_HEIGHT = 32


class UnfitImageError(Exception):
    """The file is not a panorama; the message says why, without the file's name."""


def decode_panorama(path: Path, height: int, levels: WhiteLevels | None = None) -> UInt8[ndarray, "height 2*height 3"]:
    """A panorama, turned upright by its EXIF orientation and scaled to ``height`` rows.

    Grey, palette and CMYK images become RGB, more than 8 bits 8 by the white level of ``levels``; transparent pixels
    become black. JPEG files are decoded at a half, a quarter or an eighth of their size where that is enough.

    Raises:
        UnfitImageError: it cannot be decoded, has too many pixels, or is not twice as wide as high.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns of sizes that are usual for panoramas; its limit holds
            with open_picture(path) as image:
                _check_shape(image)
                image.draft("RGB", (2 * height, height))
                picture = without_alpha(upright(eight_bits(image, path, levels))).convert("RGB")
                return np.asarray(picture.resize((2 * height, height), Image.Resampling.LANCZOS, reducing_gap=3.0))
    except UnfitImageError:
        raise
    except Exception as error:  # Pillow's decoders raise whatever they come across in a damaged file
        raise UnfitImageError(why_unreadable(path, error)) from None


def _check_shape(image: Image.Image) -> None:
    width, height = upright_size(image)
    if abs(width / (2 * height) - 1) > TOLERANCE:
        raise UnfitImageError(f"is {width} x {height} pixels, a full panorama is twice as wide as high")
    if height < SMALLEST_HEIGHT:
        raise UnfitImageError(f"is {width} x {height} pixels, at least {SMALLEST_HEIGHT} rows are needed")
