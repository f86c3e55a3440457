"""Images from any source (files, arrays, lists, Pillow images) as bytes of the required size."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from sextant.applications.arguments import check_several
from sextant.data.image_files import decode_image, picture_bytes
from sextant.data.picture_files import DECODE, UnreadableImageError, open_picture
from sextant.data.pixel_values import eight_bits, rgb_bytes
from sextant.data.upright import upright, upright_size
from sextant.errors import UserError
from sextant.user_files import absent

Size = tuple[int, int, int]
#: a file, an array of bytes, nested lists of them, or a Pillow image
AnyImage = Path | str | ndarray | Image.Image | Sequence[Any]


def checked_pixels(image: ndarray | Sequence[Any], size: Size) -> UInt8[ndarray, "h w c"]:
    """An array as bytes, if it has just this size; its values as for :func:`as_pixels`.

    Args:
        image: whole numbers in [0, 255].
        size: height, width and channels that it must have.

    Raises:
        UserError: it is not an array of bytes of this size.
    """
    pixels = _bytes(image, size)
    if pixels.shape != size:
        raise _unfit(pixels, size, "Resize it, or give its file.")
    return pixels


def rgb_pixels(picture: Image.Image, name: str) -> UInt8[ndarray, "h w 3"]:
    """A Pillow image as photos are read: upright, of 8 bits, in RGB, and mid grey where it is transparent.

    Raises:
        UserError: it cannot be decoded.
    """
    try:
        return np.asarray(rgb_bytes(upright(eight_bits(picture)), 1))
    except (ValueError, OSError) as error:  # Pillow decodes lazily
        raise UserError(f"{name} cannot be read: {error}", "Give another.") from None


def as_pixels(image: AnyImage, size: Size | None = None) -> UInt8[ndarray, "h w c"]:
    """An image as bytes, stretched to a size as files are; an image that has the size keeps its values.

    Args:
        image: the image. Whole numbers in [0, 255] of any type are bytes; a Pillow image is rotated upright by its
            EXIF block, and converted between grey and colour where needed.
        size: required height, width and channels; None for its own.

    Raises:
        UserError: it is not an image, or its values are ambiguous, like those of floating-point arrays.
    """
    if isinstance(image, Path | str):
        path = Path(image).expanduser()
        if path.is_dir():
            raise UserError(f"{image} is a folder; an image is a file", "Give the file of an image.")
        if not path.is_file():
            raise UserError(absent(image), "Give the file of an image.")
        try:
            return decode_image(path, *(size or _own_size(path)))
        except UnreadableImageError as error:
            raise UserError(f"{image}: {error}", "Replace the file, or leave it out.") from None
    if isinstance(image, Image.Image):
        picture = image
        if size is None:
            width, height = upright_size(picture)
            size = (height, width, 1 if picture.mode in ("1", "L", "I", "I;16") else 3)
    else:
        pixels = _bytes(image, size)
        if size is None or pixels.shape == size:
            return pixels
        picture = Image.fromarray(pixels[..., 0] if pixels.shape[2] == 1 else pixels)
    try:
        return picture_bytes(picture, *size)
    except (ValueError, OSError) as error:
        raise UserError(f"the image cannot be used: {error}", "Give another.") from None


def detached(values: Any) -> Any:
    """The array of a tensor from any device, without its gradient; other values as they are.

    Raises:
        TypeError, RuntimeError: NumPy has no such arrays.
    """
    return values.detach().cpu().numpy() if hasattr(values, "requires_grad") else values


def several_pixels(images: Sequence[AnyImage] | UInt8[ndarray, "n h w c"]) -> UInt8[ndarray, "n h w c"]:
    """Images of one size, that of the first.

    Raises:
        UserError: there are none, or one is not an image; the message gives its index, from 0.
    """
    if isinstance(images, ndarray) and images.ndim == 4 and images.dtype == np.uint8 and len(images):
        return images
    check_several("images", images)
    found: list[ndarray] = []
    for number, image in enumerate(images):
        try:
            found.append(as_pixels(image, found[0].shape if found else None))
        except UserError as error:
            raise UserError(f"image {number}: {error.problem}", error.fix) from None
    if not found:
        raise UserError("images: there is none", "Give one image for each pose.")
    return np.stack(found)


def _own_size(path: Path) -> Size:
    try:
        with open_picture(path) as image:
            width, height = upright_size(image)
            return height, width, 3
    except OSError:
        return 4, 4, 3  # decoding then reports what is wrong


def _bytes(image: Any, size: Size | None) -> UInt8[ndarray, "h w c"]:
    try:
        pixels = np.asarray(detached(image))
    except (TypeError, ValueError, RuntimeError):  # lists of unequal lengths or of tensors, kinds that NumPy lacks
        pixels = np.empty(0, object)
    pixels = pixels[..., None] if pixels.ndim == 2 else pixels
    whole = np.issubdtype(pixels.dtype, np.integer) and pixels.size and pixels.min() >= 0 and pixels.max() <= 255
    channels = (1, 3) if size is None else (1, 3, size[2])
    if pixels.ndim != 3 or pixels.shape[2] not in channels or not whole or min(pixels.shape[:2]) < 1:
        give = "Give an array of values from 0 to 255, height x width x 1 or 3; or its file."
        raise _unfit(pixels, size, DECODE if isinstance(image, bytes | bytearray) else give)
    return pixels.astype(np.uint8, copy=False)


def _unfit(pixels: ndarray, size: Size | None, fix: str) -> UserError:
    shape = "x".join(map(str, pixels.shape))
    found = f"{pixels.dtype} {shape}" if pixels.ndim else f"of type {type(pixels.item()).__name__}"
    needed = "" if size is None else " " + "x".join(map(str, size))
    return UserError(f"the image is {found}; the network takes uint8{needed}", fix)
