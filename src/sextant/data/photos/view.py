"""A photo, and the part of it that is a network's input."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray
from PIL import Image

from sextant.geometry.canvas import picture_size


@dataclass(frozen=True)
class Photo:
    """A decoded photo.

    Attributes:
        image: upright RGB bytes, ``(h, w, 3)``; smaller than the original if that is very large.
        width: of the upright original, pixels.
        height: of the upright original, pixels.
        orientation: EXIF orientation of the file, 1 to 8; 1 is upright.
        exif_focal_px: focal length from EXIF in pixels of the original, or None.
        cropped: whether EXIF describes a picture of a different shape, so that the optical axis may be anywhere in this
            one.
        gravity: from the phone's accelerometer: right, down and forward in the upright picture, of unit length; None if
            the metadata do not give it.
    """

    image: UInt8[ndarray, "h w 3"]
    width: int
    height: int
    orientation: int
    exif_focal_px: float | None
    cropped: bool = False
    gravity: tuple[float, float, float] | None = None

    @property
    def scale(self) -> float:
        """Pixels of :attr:`image` per pixel of the original; 1 unless the photo is very large."""
        rows, columns = self.image.shape[:2]
        return float(max(rows / self.height, columns / self.width))


@dataclass(frozen=True)
class NetworkView:
    """The part of a photo that is the network's input.

    Attributes:
        image: RGB bytes of the network's size; squashed unless that size has the aspect of the part.
        aspect: of the part, width over height.
        left, top, width, height: the part in pixels of the upright original; its centre is that of the photo.
        share: of the photo's area that the part covers.
    """

    image: UInt8[ndarray, "h w 3"]
    aspect: float
    left: float
    top: float
    width: float
    height: float
    share: float


def network_view(
    photo: Photo, aspects: Sequence[float], width: int, height: int, *, canvas: bool = False
) -> NetworkView:
    """The largest centred part of a photo with one of the ``aspects`` that a network was trained on.

    The aspect whose part covers most of the photo is chosen, so a portrait photo keeps its full width. The part is
    averaged over areas to ``width`` x ``height``, or interpolated if it has fewer pixels. Because it has the photo's
    centre, a camera found for it is that of the photo: tilt, roll and k1 are the same, and the focal length in pixels
    of the original is that in image heights times the part's height.

    With ``canvas``, the part may have any aspect between the smallest and largest of ``aspects``, and lies in the
    middle of a black square with sides of ``width`` pixels.
    """
    shape = photo.width / photo.height
    if canvas:
        columns, rows = picture_size(width, min(max(shape, min(aspects)), max(aspects)))
        view = network_view(photo, [columns / rows], columns, rows)
        beside, above = (width - columns) // 2, (height - rows) // 2
        square = np.pad(view.image, ((above, above), (beside, beside), (0, 0)))
        return replace(view, image=square)
    aspect = max(aspects, key=lambda a: min(a, shape) / max(a, shape))
    part = (float(min(photo.width, photo.height * aspect)), float(min(photo.height, photo.width / aspect)))
    left, top = (photo.width - part[0]) / 2, (photo.height - part[1]) / 2
    rows, columns = photo.image.shape[:2]
    across, down = columns / photo.width, rows / photo.height
    box = (left * across, top * down, (left + part[0]) * across, (top + part[1]) * down)
    if box[2] - box[0] >= width and box[3] - box[1] >= height:
        resized = _area_mean(photo.image, box, width, height)
    else:
        resized = np.asarray(Image.fromarray(photo.image).resize((width, height), Image.Resampling.BILINEAR, box=box))
    share = part[0] * part[1] / (photo.width * photo.height)
    return NetworkView(resized, aspect, left, top, *part, share)


def _area_mean(
    image: UInt8[ndarray, "h w 3"], box: tuple[float, float, float, float], width: int, height: int
) -> UInt8[ndarray, "height width 3"]:
    """Means over the cells of a grid on ``box``, whose borders may lie inside pixels (Pillow rounds them)."""
    rows = np.stack(
        [
            np.tensordot(weights, image[first : first + len(weights)].astype(np.float32), 1)
            for first, weights in _overlaps(box[1], box[3], height, image.shape[0])
        ]
    )
    both = np.stack([
        np.tensordot(rows[:, first : first + len(weights)], weights, (1, 0))
        for first, weights in _overlaps(box[0], box[2], width, image.shape[1])
    ], axis=1)  # fmt: skip
    mean: UInt8[ndarray, "height width 3"] = both.round().astype(np.uint8)
    return mean


def _overlaps(start: float, end: float, count: int, size: int) -> Iterator[tuple[int, Float[ndarray, "n"]]]:
    """For each of ``count`` equal parts of a line: its first pixel, and the shares of the pixels from there on."""
    edges = np.clip(np.linspace(start, end, count + 1), 0, size)
    for low, high in pairwise(edges):
        first, last = int(low), min(math.ceil(high), size)
        ends = np.clip(np.arange(first, last + 1), low, high)
        yield first, (np.diff(ends) / (high - low)).astype(np.float32)
