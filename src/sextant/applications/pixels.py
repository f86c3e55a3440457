"""Images that were decoded elsewhere."""

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from sextant.errors import UserError


def checked_pixels(image: UInt8[ndarray, "h w *c"], size: tuple[int, int, int]) -> UInt8[ndarray, "h w c"]:
    """An image with an axis of channels.

    Args:
        image: bytes.
        size: height, width and channels that it must have.

    Raises:
        UserError: it is no array of bytes of this size.
    """
    pixels = image[..., None] if image.ndim == 2 else image
    if pixels.dtype != np.uint8 or pixels.shape != size:
        shape, needed = ("x".join(map(str, sides)) for sides in (pixels.shape, size))
        raise UserError(
            f"the image is {pixels.dtype} {shape}; the network takes uint8 {needed}", "Resize it, or give its file."
        )
    return pixels
