"""Images with poses by COLMAP, from text and from binary files, and its camera models.

Source: COLMAP 4.2, ``src/colmap/sensor/models.h``; the first parameter is a focal length in pixels, except for a
panorama (EQUIRECTANGULAR), whose parameters are its sides.
"""

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sextant.data.reconstructions.reconstruction import (
    Lens,
    PosedImage,
    Reconstruction,
    finite,
    inverted,
    reconstruction_of,
    rotation_of,
)
from sextant.errors import UserError
from sextant.user_files import absent, read_lines, read_text

FIX = "Export the model as text again: colmap model_converter --output_type TXT"


def read_colmap_text(path: Path) -> Reconstruction:
    """Read the images of ``images.txt``; lenses are those of ``cameras.txt`` beside it, if it exists.

    An image takes two lines, ``IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`` and its points, ``X Y POINT3D_ID`` each;
    the quaternion and the translation are ``camera_from_world``, with x right, y down and z forward. The second line
    may be empty, and programs that write poses alone leave it out: it is recognised by its content. A camera is a line
    ``CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]``. Lines that start with # are comments. Source: COLMAP's documentation,
    "Output Format".

    Raises:
        UserError: a file cannot be read, or a line is not of this format; the message names it.
    """
    cameras = path.with_name("cameras.txt")
    lenses = _lenses(cameras) if cameras.is_file() else {}
    found: list[PosedImage | str] = []
    follows = False  # an image, whose points may come
    for number, line in enumerate(read_text(path, FIX).splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if follows and _are_points(line.split()):
            follows = False
            continue
        follows = True
        words = line.split(maxsplit=9)
        values = finite(words[1:8], 7) if len(words) == 10 and words[0].isdecimal() else None
        if values is None:
            found.append(f"line {number}: not IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME: {line[:40]}")
        elif (rotation := rotation_of(values[:4])) is None:
            found.append(f"line {number}: the quaternion has not length 1")
        else:
            pose = inverted(rotation, values[4:])
            found.append(PosedImage(words[9].strip(), pose, lenses.get(words[8])))
    return reconstruction_of(path, found, fix=FIX)


def _lenses(path: Path) -> dict[str, Lens]:
    found: dict[str, Lens] = {}
    for number, words in read_lines(path, FIX):
        numbers = finite([words[2], words[3], *words[4:]], len(words) - 2) if len(words) > 4 else None
        if numbers is None:
            begins = " ".join(words)[:40]
            raise UserError(f"{path}, line {number}: not CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]: {begins}", FIX)
        found[words[0]] = lens_of(words[1], int(numbers[0]), int(numbers[1]), numbers[2:].tolist())
    return found


def _are_points(words: Sequence[str]) -> bool:
    """Whether a line consists of points, each two finite numbers and a whole one, and is no image without its name."""
    numbers = finite(words, len(words))
    if numbers is None or len(words) % 3 or any(not word.removeprefix("-").isdecimal() for word in words[2::3]):
        return False
    return len(words) != 9 or rotation_of(numbers[1:5]) is None


BINARY_FIX = "Copy the model again, or write it as text: colmap model_converter --output_type TXT"
POINT_BYTES = 24


class _Bytes:
    """A file read sequentially from its beginning."""

    def __init__(self, path: Path):
        self.path, self.at = path, 0
        try:
            self.content = path.read_bytes()
        except OSError as error:
            problem = f"{path} cannot be read: {error.strerror}" if path.exists() else absent(path)
            raise UserError(problem, BINARY_FIX) from None

    def take(self, layout: str) -> tuple[float, ...]:
        """Read numbers in a layout of :mod:`struct`."""
        try:
            found = struct.unpack_from(f"<{layout}", self.content, self.at)
        except struct.error:
            raise self.truncated() from None
        self.at += struct.calcsize(f"<{layout}")
        return found

    def text(self) -> str:
        """Read text up to the next zero byte."""
        end = self.content.find(b"\0", self.at)
        if end < 0:
            raise self.truncated()
        name = self.content[self.at : end].decode("utf-8", "replace")
        self.at = end + 1
        return name

    def skip(self, count: int) -> None:
        """Skip bytes, which must exist."""
        self.at += count
        if self.at > len(self.content):
            raise self.truncated()

    def truncated(self) -> UserError:
        """The error for a file that ends too early."""
        return UserError(f"{self.path} is truncated, or not a COLMAP file ({len(self.content):,} bytes)", BINARY_FIX)


def read_colmap_binary(path: Path) -> Reconstruction:
    """Read the images of ``images.bin``; lenses are those of ``cameras.bin`` beside it, if it exists.

    ``images.bin``: a uint64 count, then for each image uint32 id, 4 doubles (w, x, y, z) and 3 doubles of
    ``camera_from_world``, uint32 camera, a name that ends in a zero byte, a uint64 count of points and 24 bytes for
    each. ``cameras.bin``: a uint64 count, then uint32 id, int32 model, uint64 width and height, and the model's
    parameters as doubles. Source: COLMAP, ``src/colmap/scene/reconstruction_io_binary.cc``.

    Raises:
        UserError: a file cannot be read, is truncated, or has an invalid pose; the message names it.
    """
    cameras = path.with_name("cameras.bin")
    lenses = _binary_lenses(cameras) if cameras.is_file() else {}
    file = _Bytes(path)
    found: list[PosedImage | str] = []
    for _ in range(int(file.take("Q")[0])):
        _, *values, camera = file.take("I7dI")
        name = file.text()
        file.skip(POINT_BYTES * int(file.take("Q")[0]))
        numbers = finite(values, 7)
        rotation = None if numbers is None else rotation_of(numbers[:4])
        if numbers is None or rotation is None:
            found.append(f"{name}: {np.round(values, 3).tolist()} is not a pose")
        else:
            found.append(PosedImage(name, inverted(rotation, numbers[4:]), lenses.get(int(camera))))
    return reconstruction_of(path, found, fix=BINARY_FIX)


def _binary_lenses(path: Path) -> dict[int, Lens]:
    file = _Bytes(path)
    found: dict[int, Lens] = {}
    for _ in range(int(file.take("Q")[0])):
        number, model, width, height = (int(value) for value in file.take("IiQQ"))
        if model not in MODELS:  # the number of its parameters is unknown
            raise UserError(
                f"{path}: camera {number} has the model {model}, which is not known here; known are "
                f"{', '.join(name for name, _ in MODELS.values())}",
                BINARY_FIX,
            )
        name, count = MODELS[model]
        found[number] = lens_of(name, width, height, file.take(f"{count}d"))
    return found


#: number in binary files -> name and number of parameters
MODELS = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8),
    6: ("FULL_OPENCV", 12),
    7: ("FOV", 5),
    8: ("SIMPLE_RADIAL_FISHEYE", 4),
    9: ("RADIAL_FISHEYE", 5),
    10: ("THIN_PRISM_FISHEYE", 12),
    11: ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    12: ("SIMPLE_DIVISION", 4),
    13: ("DIVISION", 5),
    14: ("SIMPLE_FISHEYE", 3),
    15: ("FISHEYE", 4),
    16: ("EUCM", 6),
    17: ("EQUIRECTANGULAR", 2),
}


#: models that OpenCV has too -> places of fx, fy, cx, cy, k1, k2, p1, p2 among the parameters; None: 0
OPENCV: dict[str, tuple[int | None, ...]] = {
    "SIMPLE_PINHOLE": (0, 0, 1, 2, None, None, None, None),
    "PINHOLE": (0, 1, 2, 3, None, None, None, None),
    "SIMPLE_RADIAL": (0, 0, 1, 2, 3, None, None, None),
    "RADIAL": (0, 0, 1, 2, 3, 4, None, None),
    "OPENCV": (0, 1, 2, 3, 4, 5, 6, 7),
}


def lens_of(model: str, width: int, height: int, params: Sequence[float]) -> Lens:
    """The lens of a camera; COLMAP's first pixel has its centre at (0.5, 0.5)."""
    places = OPENCV.get(model)
    opencv = None
    if places is not None and len(params) > max(each for each in places if each is not None):
        values = [0.0 if each is None else float(params[each]) for each in places]
        opencv = (*values[:2], values[2] - 0.5, values[3] - 0.5, *values[4:])
    return Lens(model, width, height, None if model == "EQUIRECTANGULAR" else float(params[0]), opencv)
