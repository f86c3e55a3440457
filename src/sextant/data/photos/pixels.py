"""Pixels of any kind as RGB bytes."""

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

ALPHA_BACKGROUND = 128


def rgb_bytes(image: Image.Image, factor: int) -> Image.Image:
    """A loaded picture of any mode as RGB, averaged over squares of ``factor`` pixels.

    More than 8 bits become 8, scaled from the fewest bits that hold the largest value; transparent pixels become mid
    grey.
    """
    if image.mode.startswith("I") or image.mode == "F":
        image = Image.fromarray(_eight_bits(np.asarray(image)))
    if image.mode in ("P", "1", "PA"):  # their numbers cannot be averaged
        image = image.convert("RGBA" if _has_alpha(image) else "RGB")
    elif "transparency" in image.info and image.mode in ("RGB", "L"):
        image = image.convert("RGBA")
    if factor > 1:
        image = image.reduce(factor)
    if not _has_alpha(image):
        return image if image.mode == "RGB" else image.convert("RGB")  # the latter copies
    image = image.convert("RGBA")
    background = Image.new("RGB", image.size, (ALPHA_BACKGROUND,) * 3)
    background.paste(image, mask=image.getchannel("A"))
    return background


def _has_alpha(image: Image.Image) -> bool:
    return image.mode in ("RGBA", "LA", "PA", "La", "RGBa") or (image.mode == "P" and "transparency" in image.info)


def _eight_bits(values: ndarray) -> UInt8[ndarray, "h w"]:
    """Reduce values to 8 bits from the fewest bits that hold the largest; floats of at most 1 are taken as shares."""
    if values.dtype.kind == "f":
        finite = np.nan_to_num(values, nan=0, posinf=0, neginf=0).clip(min=0)
        top = finite.max()
        eight: UInt8[ndarray, "h w"] = (finite * (255 / (1 if top <= 1 else max(top, 255)))).round().astype(np.uint8)
        return eight
    values = values.clip(min=0)
    top = int(values.max())
    bits = next((b for b in (8, 10, 12, 14, 16) if top < 1 << b), top.bit_length())
    shifted: UInt8[ndarray, "h w"] = (values >> (bits - 8)).astype(np.uint8)
    return shifted
