"""COLMAP's ``images.bin`` and ``cameras.bin``, little-endian.

``images.bin``: a uint64 count, then for each image uint32 id, 4 doubles (w, x, y, z) and 3 doubles of
``camera_from_world``, uint32 camera, a name that ends in a zero byte, a uint64 count of points and 24 bytes for each.
``cameras.bin``: a uint64 count, then uint32 id, int32 model, uint64 width and height, and the model's parameters as
doubles. Source: COLMAP, ``src/colmap/scene/reconstruction_io_binary.cc``.
"""

import struct
from pathlib import Path

import numpy as np

from sextant.data.reconstructions.colmap_models import MODELS, lens_of
from sextant.data.reconstructions.reconstruction import (
    Lens,
    PosedImage,
    Reconstruction,
    finite,
    inverted,
    reconstruction_of,
    rotation_of,
    unusable,
)
from sextant.errors import UserError
from sextant.user_files import absent

FIX = "Copy the model again, or write it as text: colmap model_converter --output_type TXT"
POINT_BYTES = 24


class _Bytes:
    """A file read sequentially from its beginning."""

    def __init__(self, path: Path):
        self.path, self.at = path, 0
        try:
            self.content = path.read_bytes()
        except OSError as error:
            problem = f"{path} cannot be read: {error.strerror}" if path.exists() else absent(path)
            raise UserError(problem, FIX) from None

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
        return UserError(f"{self.path} is truncated, or no file of COLMAP ({len(self.content):,} bytes)", FIX)


def read_colmap_binary(path: Path) -> Reconstruction:
    """Read the images of ``images.bin``; lenses are those of ``cameras.bin`` beside it, if it exists.

    Raises:
        UserError: a file cannot be read, is truncated, or has an invalid pose; the message names it.
    """
    cameras = path.with_name("cameras.bin")
    lenses = _lenses(cameras) if cameras.is_file() else {}
    file = _Bytes(path)
    images: list[PosedImage] = []
    problems: list[str] = []
    for _ in range(int(file.take("Q")[0])):
        _, *values, camera = file.take("I7dI")
        name = file.text()
        file.skip(POINT_BYTES * int(file.take("Q")[0]))
        numbers = finite(values, 7)
        rotation = None if numbers is None else rotation_of(numbers[:4])
        if numbers is None or rotation is None:
            problems.append(f"{name}: {np.round(values, 3).tolist()} is no pose")
        else:
            images.append(PosedImage(name, inverted(rotation, numbers[4:]), lenses.get(int(camera))))
    if problems:
        raise unusable(path, problems, FIX)
    return reconstruction_of(path, images)


def _lenses(path: Path) -> dict[int, Lens]:
    file = _Bytes(path)
    found: dict[int, Lens] = {}
    for _ in range(int(file.take("Q")[0])):
        number, model, width, height = (int(value) for value in file.take("IiQQ"))
        if model not in MODELS:  # the number of its parameters is unknown
            raise UserError(
                f"{path}: camera {number} has the model {model}, which is not known here; known are "
                f"{', '.join(name for name, _ in MODELS.values())}",
                FIX,
            )
        name, count = MODELS[model]
        found[number] = lens_of(name, width, height, float(file.take(f"{count}d")[0]))
    return found
