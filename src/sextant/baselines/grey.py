"""Grey images of one size, which every training-free descriptor starts from."""

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray
from PIL import Image

#: ITU-R BT.601 weights of red, green and blue.
LUMA = np.array([0.299, 0.587, 0.114], np.float32)


def grey_images(images: UInt8[ndarray, "n h w c"], height: int, width: int) -> Float32[ndarray, "n height width"]:
    """Luma ``0.299 R + 0.587 G + 0.114 B`` in [0, 1], resized with an antialiasing triangle filter.

    Images that have the size already are not resampled. The aspect ratio is not kept.

    >>> grey_images(np.zeros((2, 48, 64, 3), np.uint8), 24, 32).shape
    (2, 24, 32)

    Args:
        images: one or three channels.
        height, width: size of the result in pixels, at least 1.

    Raises:
        ValueError: there is no image, or they are not uint8 with one or three channels.
    """
    if images.ndim != 4 or images.dtype != np.uint8 or len(images) == 0 or images.shape[3] not in (1, 3):
        raise ValueError(f"need uint8 images (n, h, w, 1 or 3), n > 0; got {images.dtype} {images.shape}")
    grey = images[..., 0].astype(np.float32) if images.shape[3] == 1 else images.astype(np.float32) @ LUMA
    grey /= 255
    if grey.shape[1:] == (height, width):
        return grey
    resized = np.empty((len(grey), height, width), np.float32)
    for target, image in zip(resized, grey, strict=True):
        target[:] = np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.BILINEAR))
    return resized
