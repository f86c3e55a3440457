r"""Pictures of more than 8 bits as bytes, by one rule for all readers.

Files of 16 or 32 bits rarely use all of them: cameras write 10, 12 or 14 bits into 16. The white level of a picture is
:math:`2^b - 1`, with :math:`b` the fewest of 8, 10, 12, 14, 16, 24 and 32 bits that hold the largest value of *all*
pictures of its kind that belong together (a data set, or else the files of its folder), and bytes are the upper 8 of
these :math:`b` bits. So a night picture stays darker than a day picture, whatever its own largest value. A kind
is a suffix, size and type of values; up to :data:`SAMPLE` pictures are examined, and brighter ones beyond them have
their own level. Floating-point values of at most :data:`SHARES` are shares of 1; else whole numbers as above.

8-bit pictures are untouched. A level below the file's bits is logged, once for the pictures that belong together.
"""

import logging
import os
import threading
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Num, UInt8
from numpy import ndarray
from PIL import Image

from sextant.data.file_kinds import is_hidden
from sextant.data.picture_files import open_picture

log = logging.getLogger(__name__)

#: changes whenever the conversion of deeper files to bytes does
LEVELS = "white levels 1"
BITS = (8, 10, 12, 14, 16, 24, 32)
#: pictures examined for their common level, and those opened in search of them
SAMPLE, SEARCHED = 64, 2000
#: largest floating-point value taken as a share of white, which resampling and highlights exceed a little; and that
#: from which on floating-point values are taken as whole numbers. In between, the white level is unknown.
SHARES, WHOLE = 1.5, 16.0
ALPHA_BACKGROUND = 128
BITS_PER_SAMPLE, PHOTOMETRIC, SAMPLE_FORMAT = 0x0102, 0x0106, 0x0153


@lru_cache(maxsize=1024)
def warn_once(message: str) -> None:
    """Log a warning about files that are read or listed many times."""
    log.warning("%s", message)


class _Kind(NamedTuple):
    suffix: str
    size: tuple[int, int]
    values: str


class WhiteLevels:
    """White levels of pictures that belong together.

    Args:
        paths: all their files; other files may be among them. They are listed once a deeper picture is met.
        name: of them together, for messages; None for the folder around them.
    """

    def __init__(self, paths: Iterable[Path], name: str | None = None):
        self._paths, self._name = paths, name
        self._tops: dict[_Kind, float] = {}
        self._told: set[_Kind] = set()
        self._lock = threading.Lock()

    def of(self, path: Path | None, values: Num[ndarray, "h w *c"]) -> float:
        """The white level of a picture's values.

        Raises:
            ValueError: they are floating-point values whose white level is unknown.
        """
        kind = _Kind(path.suffix.lower() if path else "", values.shape[1::-1], str(values.dtype))
        with self._lock:
            if kind not in self._tops:
                self._tops[kind] = self._top(kind) if path else 0.0
            top = max(self._tops[kind], _top(values))
            if path is None:  # of a stream, whose later pictures are not known yet
                self._tops[kind] = top
            white = _white(top, values.dtype.kind == "f")
            if kind not in self._told and white != np.iinfo(np.uint16).max and top > 0:
                self._told.add(kind)
                where = self._name or (path.parent if path else "images")
                width, height = kind.size
                warn_once(
                    f"{where}: {kind.values} values of pictures of {width}x{height} pixels go up to {top:.6g}: "
                    f"white is taken as {white:.6g}{_in_bits(white)}"
                )
        return white

    def _top(self, kind: _Kind) -> float:
        """The largest value of a sample of the files of a kind; 0 if there is none."""
        self._paths = list(self._paths)
        alike = [path for path in self._paths if path.suffix.lower() == kind.suffix]
        order = np.random.default_rng(0).permutation(len(alike))[:SEARCHED]
        top, examined = 0.0, 0
        for i in order:
            values = _values_of_file(alike[i], kind)
            if values is not None:
                top, examined = max(top, _top(values)), examined + 1
            if examined == SAMPLE or (kind.values == "uint16" and top >= 1 << 14):
                break
        return top


def eight_bits(image: Image.Image, path: Path | None = None, levels: WhiteLevels | None = None) -> Image.Image:
    """An open picture with 8 bits per channel; itself if it has no more.

    Args:
        image: an open picture of any mode.
        path: its file, which is decoded anew where Pillow drops the lower bits.
        levels: those of the pictures that it belongs to; None for those of its folder, or its own if it has no file.

    Raises:
        ValueError: the white level of its values is unknown.
    """
    tiles = getattr(image, "tile", ())
    scaled = any(tile[0] == "ppm" and tile[3][1] != 65535 for tile in tiles)  # by Pillow, to 16 bits
    values = deep_values(image, path)
    if values is None:
        return image
    white = 65535.0 if scaled else (levels or _levels_of(path)).of(path, values)
    grey_or_rgb = _bytes(values[..., :3] if values.ndim == 3 else values, white)
    if image.format == "TIFF" and values.ndim == 2 and getattr(image, "tag_v2", {}).get(PHOTOMETRIC) == 0:
        grey_or_rgb = 255 - grey_or_rgb  # white is zero; Pillow heeds this up to 8 bits only
    if values.ndim == 3 and values.shape[2] == 4:
        opaque = _bytes(values[..., 3], _white(_top(values[..., 3]), values.dtype.kind == "f"))
        grey_or_rgb = np.dstack([grey_or_rgb, opaque])
    eight = Image.fromarray(grey_or_rgb)
    eight.info = {key: value for key, value in image.info.items() if "exif" in key}
    return eight


def without_alpha(image: Image.Image) -> Image.Image:
    """An 8-bit picture without transparency, composited on black."""
    if image.mode in ("LA", "PA", "La", "RGBa", "RGBA") or "transparency" in image.info:
        layer = image.convert("RGBA")
        return Image.alpha_composite(Image.new("RGBA", layer.size, (0, 0, 0, 255)), layer)
    return image


def rgb_bytes(image: Image.Image, factor: int) -> Image.Image:
    """An 8-bit picture as RGB, averaged over squares of ``factor`` pixels; transparent pixels become mid grey."""
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


def is_deep(path: Path) -> bool:
    """Whether a picture file has more than 8 bits per channel, by its header."""
    try:
        with open_picture(path) as image:
            return image.mode.startswith("I") or image.mode == "F" or _has_deep_colour(image, path)
    except Exception:  # decoding it reports what is wrong with it
        return False


def deep_values(image: Image.Image, path: Path | None = None) -> Num[ndarray, "h w *c"] | None:
    """The values of an open picture with more than 8 bits per channel, grey or RGB(A); None if it has no more."""
    if image.mode.startswith("I") or image.mode == "F":
        image.load()
        values = np.asarray(image)
        tags = getattr(image, "tag_v2", {})
        if tags.get(BITS_PER_SAMPLE) == (32,) and tags.get(SAMPLE_FORMAT, (1,)) == (1,):
            return values.view(np.uint32)  # Pillow wraps what is above 2^31
        return values.astype(np.uint16 if image.format == "PPM" else values.dtype.newbyteorder("="), copy=False)
    if path is None or not _has_deep_colour(image, path):
        return None
    import cv2

    found = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
    if found is None or found.dtype.itemsize < 2 or found.ndim != 3:
        return None
    return np.ascontiguousarray(found[..., [2, 1, 0, 3][: found.shape[2]]])


def _has_deep_colour(image: Image.Image, path: Path) -> bool:
    """Whether Pillow has dropped the lower bits of an open colour picture."""
    if image.format == "PNG":
        with path.open("rb") as file:
            return file.read(25)[24:] == b"\x10"
    if image.format == "TIFF":
        bits = getattr(image, "tag_v2", {}).get(BITS_PER_SAMPLE, ())
        return image.mode in ("RGB", "RGBA") and max(bits, default=8) > 8
    return image.format == "PPM" and any(tile[3] == ("RGB", 65535) for tile in getattr(image, "tile", ()))


def _values_of_file(path: Path, kind: _Kind) -> ndarray | None:
    try:
        with open_picture(path) as image:
            if image.size not in (kind.size, kind.size[::-1]):
                return None
            values = deep_values(image, path)
    except Exception:  # decoding it reports what is wrong with it
        return None
    return values if values is not None and str(values.dtype) == kind.values else None


def _levels_of(path: Path | None) -> WhiteLevels:
    if path is None:
        return WhiteLevels([])
    folder = path.absolute().parent
    return _levels_of_folder(folder, folder.stat().st_mtime_ns)


@lru_cache(maxsize=64)
def _levels_of_folder(folder: Path, changed_ns: int) -> WhiteLevels:
    return levels_of_folders([folder])


def levels_of_folders(folders: Iterable[Path]) -> WhiteLevels:
    """The white levels that the files directly in these folders share."""
    there = (folder for folder in folders if folder.is_dir())
    return WhiteLevels(Path(each.path) for folder in there for each in os.scandir(folder) if not is_hidden(each.name))


def _top(values: ndarray) -> float:
    colour = values[..., :3] if values.ndim == 3 else values
    if values.dtype.kind == "f":
        colour = colour[np.isfinite(colour)]
    return float(max(colour.max(initial=0), 0))


def _white(top: float, floating: bool) -> float:
    if floating and top <= SHARES:
        return 1.0
    if floating and top < WHOLE:
        raise ValueError(
            f"floating-point values up to {top:.3g}, whose white level is unknown: "
            "scale them so that white is 1, or save 8 or 16 bits"
        )
    return float(next((1 << bits for bits in BITS if top < 1 << bits), 1 << int(top).bit_length()) - 1)


def _bytes(values: ndarray, white: float) -> UInt8[ndarray, "h w *c"]:
    if values.dtype.kind == "f":
        share = np.nan_to_num(values, nan=0, posinf=white, neginf=0).clip(0, white)
        eight: UInt8[ndarray, "h w *c"] = (share * (255 / white)).round().astype(np.uint8)
        return eight
    largest = min(int(white), np.iinfo(values.dtype).max)
    eight = (values.clip(0, largest) >> (int(white).bit_length() - 8)).astype(np.uint8)
    return eight


def _in_bits(white: float) -> str:
    return "" if white == 1 else f" ({int(white).bit_length()} bits)"


def _has_alpha(image: Image.Image) -> bool:
    return image.mode in ("RGBA", "LA", "PA", "La", "RGBa") or (image.mode == "P" and "transparency" in image.info)
