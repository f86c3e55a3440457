r"""A person's photo: decoded whatever its format, cut for the network, and straightened.

Pixels are those of the *upright original*: columns and rows after the EXIF orientation, from the top left corner, with
centres at + 0.5. A photo with more than 64 megapixels is decoded at a half, a third, ... of its size, so that memory is
bounded; all lengths are still told in pixels of the original.

With the 35-mm equivalent focal length :math:`f_{35}` of the EXIF block, which compares diagonals,
:math:`f = f_{35} \sqrt{W^2 + H^2} / \sqrt{36^2 + 24^2}` pixels. Source: CIPA DCG-001, "Guideline for noting
digital camera specifications in catalogs"; the tags are of Exif 2.32.

Straightening needs no inversion: a pixel at the normalised point p of the straight picture is seen at
:math:`f (1 + k_1 |p|^2 + k_2 |p|^4) p` from the centre of the photo.
"""

import math
import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray
from PIL import Image

from sextant.errors import UserError
from sextant.geometry import max_radius, undistort_radius

#: what is decoded; no format whose decoder runs another program (EPS) is among them
FORMATS = ("JPEG", "MPO", "PNG", "TIFF", "BMP", "WEBP", "PPM", "GIF", "JPEG2000", "AVIF")
SMALLEST_SIDE = 32
LARGEST_DECODED = 64_000_000  # pixels that are kept
LARGEST_SIDE = 32_000  # of what is kept: cv2.remap counts in 16 bits
LARGEST_FILE = 512_000_000  # pixels of a JPEG, which can be decoded at 1/2, 1/4 or 1/8
LARGEST_WHOLE = 256_000_000  # pixels of formats that are decoded whole: 1 GiB at Pillow's four bytes
ALPHA_BACKGROUND = 128
FULL_FRAME_DIAGONAL = math.hypot(36, 24)
STRIP = 256  # rows that are straightened at a time

ORIENTATION = 0x0112
EXIF_BLOCK, FOCAL_LENGTH, FOCAL_35MM = 0x8769, 0x920A, 0xA405
PLANE_X_RESOLUTION, PLANE_UNIT, PIXELS_X, PIXELS_Y = 0xA20E, 0xA210, 0xA002, 0xA003
MILLIMETRES = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}  # of the unit of the focal plane's resolution
TURN = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}
Keep = Literal["crop", "all"]
_pillow = threading.Lock()  # its limit of pixels is a global variable


@dataclass(frozen=True)
class Photo:
    """A decoded photo.

    Attributes:
        image: upright RGB bytes, ``(h, w, 3)``; smaller than the original where that is very large.
        width: of the upright original, pixels.
        height: of the upright original, pixels.
        orientation: of the file by EXIF, 1 to 8; 1 is upright.
        exif_focal_px: focal length in pixels of the original by EXIF, or None.
    """

    image: UInt8[ndarray, "h w 3"]
    width: int
    height: int
    orientation: int
    exif_focal_px: float | None

    @property
    def scale(self) -> float:
        """Pixels of :attr:`image` for one of the original; 1 unless the photo is very large."""
        rows, columns = self.image.shape[:2]
        return float(max(rows / self.height, columns / self.width))


@dataclass(frozen=True)
class NetworkView:
    """The part of a photo that the network sees.

    Attributes:
        image: RGB bytes of the network's size; squashed unless that has the aspect of the part.
        aspect: of the part, width over height.
        left, top, width, height: the part in pixels of the upright original; its centre is that of the photo.
        share: of the photo's area.
    """

    image: UInt8[ndarray, "h w 3"]
    aspect: float
    left: float
    top: float
    width: float
    height: float
    share: float


def read_photo(path: Path) -> Photo:
    """Decode a photo: upright, RGB, 8 bits; of a file with several pictures the first.

    Grey becomes three equal channels; 10, 12, 14 and 16 bits become 8, by the fewest that hold the largest value; CMYK
    and palettes become RGB; what is transparent becomes mid grey (128). Colour profiles are not applied.

    Raises:
        UserError: the file is missing, empty, truncated, not a picture of a format known here, smaller than 32 pixels a
            side, or larger than 512 megapixels (JPEG) or 256 (formats that can only be decoded whole).
    """
    if not path.is_file():
        raise UserError(f"{path}: no such file")
    size = path.stat().st_size
    if size == 0:
        raise UserError(f"{path} is empty (0 bytes)", "Copy the photo again.")
    try:
        with _without_pillow_limit(), Image.open(path, formats=_formats()) as image:
            return _decode(image, path)
    except (UserError, MemoryError):
        raise
    except Exception as error:  # the decoders raise almost anything on broken files
        problem = f"{path} cannot be read as a photo ({size:,} bytes): {error or type(error).__name__}"
        raise UserError(problem, _hint(path)) from None


def network_view(photo: Photo, aspects: Sequence[float], width: int, height: int) -> NetworkView:
    """The largest centred part of a photo with one of the ``aspects`` that a network was trained on.

    Of the aspects, the one whose part covers most of the photo. A portrait photo is so cut to the full width. The part
    is averaged over areas to ``width`` x ``height``, or interpolated where it has fewer pixels. Because it has the
    photo's centre, a camera found for it is that of the photo: tilt, roll and k1 are the same, and the focal length in
    pixels of the original is the one in image heights times the part's height.
    """
    shape = photo.width / photo.height
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
    """Means over the areas of a grid on ``box``, borders of areas inside a pixel included (Pillow's round them)."""
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
    """For each of ``count`` equal parts of a line its first pixel, and the share of it that each from there on has."""
    edges = np.clip(np.linspace(start, end, count + 1), 0, size)
    for low, high in pairwise(edges):
        first, last = int(low), min(math.ceil(high), size)
        ends = np.clip(np.arange(first, last + 1), low, high)
        yield first, (np.diff(ends) / (high - low)).astype(np.float32)


def undistort_photo(
    image: UInt8[ndarray, "h w 3"], focal: float, k1: float, k2: float, keep: Keep = "crop"
) -> tuple[UInt8[ndarray, "h w 3"], float]:
    """The picture that a lens without distortion would have taken, of the same size, and its focal length in pixels.

    Args:
        image: the photo.
        focal: its focal length in pixels of ``image``.
        k1: first coefficient of its distortion.
        k2: second coefficient.
        keep: ``crop`` leaves out what would leave a border without picture; ``all`` keeps every pixel, with black
            borders (as far as the lens model reaches: no ray is seen beyond its fold).
    """
    import cv2

    height, width = image.shape[:2]
    straight = straight_focal(width, height, focal, k1, k2, keep)
    fold = float(max_radius(torch.tensor(k1, dtype=torch.float64), torch.tensor(k2, dtype=torch.float64)))
    border = cv2.BORDER_REPLICATE if keep == "crop" else cv2.BORDER_CONSTANT
    result = np.empty_like(image)
    x = (np.arange(width) + 0.5 - width / 2) / straight
    for start in range(0, height, STRIP):
        y = (np.arange(start, min(start + STRIP, height)) + 0.5 - height / 2)[:, None] / straight
        square = x * x + y * y
        factor = focal * (1 + square * (k1 + k2 * square))
        if square.max() > fold * fold:
            factor = np.where(square > fold * fold, np.inf, factor)
        columns = (factor * x + (width / 2 - 0.5)).astype(np.float32)  # OpenCV's pixels have their centres at integers
        rows = (factor * y + (height / 2 - 0.5)).astype(np.float32)
        if not np.isfinite(factor).all():
            columns, rows = (np.where(np.isfinite(factor), m, np.float32(-10)) for m in (columns, rows))
        result[start : start + STRIP] = cv2.remap(image, columns, rows, cv2.INTER_CUBIC, borderMode=border)
    return result, straight


def straight_focal(width: int, height: int, focal: float, k1: float, k2: float, keep: Keep) -> float:
    """Focal length (pixels) of the straight picture of the same size that has no borders, or that has everything.

    In the direction of a point of the photo's edge at R pixels from the centre the lens sees up to the radius
    ``r = undistort(R / f)``, and a straight picture of the same size with focal length g up to ``R / g``. So g is the
    largest (``crop``) or smallest (``all``) of ``R / r`` along the edge.
    """
    radius = torch.linspace(min(width, height) / 2, math.hypot(width, height) / 2, 4096, dtype=torch.float64)
    coefficients = (torch.tensor(value, dtype=torch.float64) for value in (k1, k2))
    candidates = radius / undistort_radius(radius / focal, *coefficients)
    return float(candidates.max() if keep == "crop" else candidates.min())


def _formats() -> list[str]:
    Image.init()
    return [name for name in FORMATS if name in Image.OPEN]


@contextmanager
def _without_pillow_limit() -> Iterator[None]:
    """Pillow's own limit warns, or raises, long before ours; and its warnings about odd metadata help nobody here."""
    with _pillow, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            yield
        finally:
            Image.MAX_IMAGE_PIXELS = limit


def _hint(path: Path) -> str:
    if path.suffix.lower() in (".heic", ".heif", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf"):
        return f"Save it as JPEG: {path.suffix} is not decoded here."
    return "Replace the file or take it out of the folder."


def _decode(image: Image.Image, path: Path) -> Photo:
    width, height = image.size
    _check_size(width, height, image.format or "", path)
    factor = 1
    while (width // factor) * (height // factor) > LARGEST_DECODED or max(width, height) / factor > LARGEST_SIDE:
        factor += 1
    exif = _exif(image)
    orientation = _orientation(image)
    focal = exif_focal_px(exif, width, height)
    if factor > 1:
        image.draft(
            "RGB", (width // factor, height // factor)
        )  # a JPEG is decoded at 1/2, 1/4 or 1/8; others ignore it
    image.load()
    turn = _orientation(image)  # Pillow has turned a TIFF by now, and its size was the upright one from the start
    rgb = _rgb(image, max(1, math.ceil(factor * image.width / width - 0.01)))
    if turn in TURN:
        rgb = rgb.transpose(TURN[turn])
    if turn >= 5:
        width, height = height, width
    return Photo(np.asarray(rgb), width, height, orientation, focal)


def _check_size(width: int, height: int, kind: str, path: Path) -> None:
    if min(width, height) < SMALLEST_SIDE:
        raise UserError(
            f"{path} has {width}x{height} pixels; the shorter side must have at least {SMALLEST_SIDE}",
            "Give a larger version of the photo.",
        )
    limit = LARGEST_FILE if kind in ("JPEG", "MPO") else LARGEST_WHOLE
    if width * height > limit:
        raise UserError(
            f"{path} has {width}x{height} pixels ({width * height / 1e6:.0f} megapixels); "
            f"{kind} is decoded up to {limit / 1e6:.0f}",
            "Scale the photo down"
            + ("." if limit == LARGEST_FILE else ", or save it as JPEG, which needs less memory."),
        )


def _rgb(image: Image.Image, factor: int) -> Image.Image:
    if image.mode.startswith("I") or image.mode == "F":
        image = Image.fromarray(_eight_bits(np.asarray(image)))
    if image.mode in ("P", "1", "PA"):  # numbers that cannot be averaged
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
    """Values of more than 8 bits in 8, by the fewest bits that hold the largest; floats of at most 1 are shares."""
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


def _exif(image: Image.Image) -> dict[int, float]:
    """Numbers of the EXIF block, without those that are not finite; empty where it is broken."""
    found: dict[int, float] = {}
    try:
        block = image.getexif().get_ifd(EXIF_BLOCK)
        for tag in (FOCAL_LENGTH, FOCAL_35MM, PLANE_X_RESOLUTION, PLANE_UNIT, PIXELS_X, PIXELS_Y):
            value = float(block.get(tag, math.nan))
            if math.isfinite(value) and value > 0:
                found[tag] = value
    except Exception:  # metadata that cannot be read is no reason to refuse the photo
        return {}
    return found


def _orientation(image: Image.Image) -> int:
    try:
        value = int(image.getexif().get(ORIENTATION, 1))
    except Exception:
        return 1
    return value if value in TURN else 1


def exif_focal_px(exif: dict[int, float], width: int, height: int) -> float | None:
    """Focal length in pixels of a picture of ``width`` x ``height`` by numbers of its EXIF block, or None.

    From the 35-mm equivalent, or else from the focal length and the resolution of the focal plane. None too where the
    block tells of another shape than the picture has (it was cropped since), or a field of view that no lens has.
    """
    long, short = max(width, height), min(width, height)
    recorded = sorted((exif.get(PIXELS_X, long), exif.get(PIXELS_Y, short)))
    if abs(recorded[1] / recorded[0] / (long / short) - 1) > 0.02:
        return None
    if FOCAL_35MM in exif:
        focal = exif[FOCAL_35MM] * math.hypot(width, height) / FULL_FRAME_DIAGONAL
    elif FOCAL_LENGTH in exif and PLANE_X_RESOLUTION in exif:
        per_millimetre = exif[PLANE_X_RESOLUTION] / MILLIMETRES.get(int(exif.get(PLANE_UNIT, 2)), 25.4)
        focal = exif[FOCAL_LENGTH] * per_millimetre * long / recorded[1]
    else:
        return None
    return focal if 0.1 < focal / long < 100 else None
