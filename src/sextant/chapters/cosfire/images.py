"""Images as a filter takes them: upright, not too large, grey or in colour."""

from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray
from PIL import Image
from torch import Tensor

from sextant.applications.pixels import rgb_pixels
from sextant.data.photos import read_photo
from sextant.data.photos.reading import SMALLEST_SIDE
from sextant.data.picture_files import DECODE, open_picture
from sextant.data.pixel_values import eight_bits, rgb_bytes
from sextant.data.upright import upright
from sextant.errors import UserError

AnyImage = Path | str | UInt8[ndarray, "h w *c"] | Image.Image


@dataclass(frozen=True)
class UprightImage:
    """A decoded image, perhaps smaller than its original.

    Attributes:
        name: its file, for error messages.
        picture: RGB bytes.
        width, height: size of the upright original, pixels.
    """

    name: str
    picture: UInt8[ndarray, "h w 3"]
    width: int
    height: int

    @property
    def scale(self) -> float:
        """Pixels of the picture per pixel of the original, across."""
        return self.ratios[0]

    @property
    def ratios(self) -> tuple[float, float]:
        """Pixels of the picture per pixel of the original, across and down, which rounding makes differ a little."""
        return self.picture.shape[1] / self.width, self.picture.shape[0] / self.height

    def tensor(self, channels: int) -> Float[Tensor, "c h w"]:
        """The picture with values in [0, 1]; a single channel is the luma."""
        picture = self.picture if channels == 3 else np.asarray(Image.fromarray(self.picture).convert("L"))[..., None]
        return torch.from_numpy(picture.copy()).permute(2, 0, 1).float() / 255

    def at(self, point: tuple[float, float]) -> tuple[float, float]:
        """A point of the original in picture coordinates; pixel centres are at whole numbers."""
        across, down = self.ratios
        return (point[0] + 0.5) * across - 0.5, (point[1] + 0.5) * down - 0.5


def upright_image(image: AnyImage | UprightImage, longest: int) -> UprightImage:
    """An image of any size; larger ones are shrunk so that their longest side has ``longest`` pixels.

    Raises:
        UserError: as for :func:`read_image`, an array is not of bytes, grey or RGB, or it is of another type.
    """
    if isinstance(image, UprightImage):
        return image
    if isinstance(image, PathLike | str):
        return read_image(Path(image).expanduser(), longest)
    if isinstance(image, Image.Image):
        image = rgb_pixels(image, "the image")
    if not isinstance(image, ndarray):
        raise UserError(
            f"the image is of type {type(image).__name__}; an image is a file, an array of bytes or a Pillow image",
            DECODE if isinstance(image, bytes | bytearray) else "Give its file.",
        )
    grey = image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 1)
    if image.dtype != np.uint8 or not image.size or not (grey or (image.ndim == 3 and image.shape[2] == 3)):
        shape = "x".join(map(str, image.shape))
        raise UserError(
            f"the image is {image.dtype} {shape}; an image is uint8, height x width, or with 3 channels",
            "Give its file.",
        )
    picture = np.broadcast_to(image.reshape(*image.shape[:2], -1), (*image.shape[:2], 3))
    return UprightImage("the image", _shrunk(picture, longest), image.shape[1], image.shape[0])


def read_image(path: Path, longest: int) -> UprightImage:
    """Decode an image of any size; larger ones are shrunk so that their longest side has ``longest`` pixels.

    Raises:
        UserError: as for :func:`~sextant.data.photos.read_photo`, except that images may be small.
    """
    try:
        photo = read_photo(path)
        image, width, height = photo.image, photo.width, photo.height
    except UserError:
        small = _small(path)
        if small is None:
            raise
        image, (height, width) = small, small.shape[:2]
    return UprightImage(str(path), _shrunk(image, longest), width, height)


def _shrunk(image: UInt8[ndarray, "h w 3"], longest: int) -> UInt8[ndarray, "h w 3"]:
    shrink = longest / max(image.shape[:2])
    if shrink >= 1:
        return image
    size = (max(1, round(image.shape[1] * shrink)), max(1, round(image.shape[0] * shrink)))
    return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BICUBIC))


def _small(path: Path) -> UInt8[ndarray, "h w 3"] | None:
    """An image too small for a photo but not for a filter; None if it is not an image or cannot be read."""
    try:
        with open_picture(path) as image:
            if min(image.size) >= SMALLEST_SIDE:
                return None
            return np.asarray(rgb_bytes(upright(eight_bits(image, path)), 1))
    except Exception:  # decoders raise almost anything, and read_photo has reported what is wrong
        return None
