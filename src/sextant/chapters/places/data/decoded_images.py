"""Decoded images. With a cache, each file is decoded once, and at most a few hundred images are in memory."""

import hashlib
import json
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from jaxtyping import Int64, UInt8
from numpy import ndarray
from numpy.lib import format as npy

from sextant.atomic_files import file_sha256, read_json, write_json
from sextant.chapters.places.data.image_rows import ImageRows
from sextant.data.image_files import decode_image
from sextant.data.picture_files import UnreadableImageError
from sextant.data.pixel_values import LEVELS, WhiteLevels, is_deep
from sextant.data.rendered.disk import reporting_disk_errors
from sextant.data.rendered.lock import notify_every
from sextant.errors import ArgumentError, UserError, problem_list
from sextant.kept_array import keep_array, open_kept
from sextant.tables import counted

#: changes whenever the same files decode into other pixels
DECODER = 1
#: images in memory at a time
CHUNK = 256


@dataclass(frozen=True)
class ImageSize:
    """Rows, columns, and 3 channels for RGB or 1 for grey."""

    height: int
    width: int
    channels: int = 3


class Together(NamedTuple):
    """Files that belong together, with a name for messages."""

    name: str
    paths: Callable[[], Iterable[Path]]


@dataclass(frozen=True)
class DecodedImages:
    """The images that could be decoded.

    Attributes:
        images: one for each of ``kept``.
        kept: indices into the given paths.
        bad: paths that could not be decoded, each with the reason.
    """

    images: ImageRows
    kept: Int64[ndarray, "k"]
    bad: tuple[str, ...]


def read_images(
    paths: Sequence[Path],
    size: ImageSize,
    cache: Path | None,
    *,
    what: str,
    skip_bad: bool,
    together: Together | None = None,
) -> DecodedImages:
    """Decode images, or memory-map them from the cache if these files were decoded before.

    Args:
        paths: of the files.
        size: of the images.
        cache: folder of decoded images; None keeps them in memory.
        what: names the files in messages: ``test frames of dataset=nordland``.
        skip_bad: leave out files that cannot be decoded; otherwise they are an error.
        together: all files whose deeper pictures share a white level, such as those of all splits; None: ``paths``.

    Raises:
        UserError: files cannot be decoded (the message names them), or the cache cannot be written to.
    """
    together = together or Together(what, lambda: paths)
    if cache is None:
        images = np.empty((len(paths), size.height, size.width, size.channels), np.uint8)
        bad: dict[int, str] = {}
        for start, part in _decoded_chunks(paths, size, what, together, bad):
            images[start : start + len(part)] = part
    else:
        images, bad = _kept(paths, size, cache, what, together)
    named = tuple(f"{paths[i].parent.name}/{paths[i].name} {bad[i]}" for i in sorted(bad))
    if bad and not skip_bad:
        raise ArgumentError(
            f"{what}: {len(bad)} of {len(paths):,} cannot be read\n{problem_list(named)}",
            "Replace them, or leave them out (they are counted): skip_bad=true",
        )
    kept = np.array([i for i in range(len(paths)) if i not in bad], np.int64)
    if not len(kept):
        raise UserError(
            f"{what}: none of {counted(len(paths), 'file')} can be read\n{problem_list(named)}", "Replace them."
        )
    return DecodedImages(ImageRows(images, kept), kept, named)


def _kept(
    paths: Sequence[Path], size: ImageSize, cache: Path, what: str, together: Together
) -> tuple[ndarray, dict[int, str]]:
    """Decoded images from the cache, written there first if necessary."""
    files = [file_sha256(path) for path in paths]
    deep: list[object] = []  # so that the digest of 8-bit files does not change
    if any(map(is_deep, paths)):
        given = set(paths)
        others = [file_sha256(path) for path in together.paths() if path not in given and path.is_file()]
        deep = [LEVELS, others] if others else [LEVELS]
    identity = [DECODER, size.height, size.width, size.channels, files, *deep]
    digest = hashlib.sha256(json.dumps(identity).encode()).hexdigest()
    folder = cache / f"decoded_places-{digest[:16]}"
    kept, listed = folder / "images.npy", folder / "bad.json"
    shape = (len(paths), size.height, size.width, size.channels)
    bad = read_json(listed)
    images = open_kept(kept, shape, np.uint8)
    if not isinstance(bad, dict) or images is None:
        found: dict[int, str] = {}
        with reporting_disk_errors(folder, lambda: int(np.prod(shape))):
            keep_array(kept, _writing(paths, size, what, together, found))
            write_json(listed, found)
        bad, images = found, open_kept(kept, shape, np.uint8)
        assert images is not None
    return images, {int(i): str(reason) for i, reason in bad.items()}


def _writing(
    paths: Sequence[Path], size: ImageSize, what: str, together: Together, bad: dict[int, str]
) -> Callable[[BinaryIO], None]:
    header = BytesIO()
    shape = (len(paths), size.height, size.width, size.channels)
    npy.write_array_header_1_0(header, {"descr": "|u1", "fortran_order": False, "shape": shape})

    def write(file: BinaryIO) -> None:
        file.write(header.getvalue())
        for _, part in _decoded_chunks(paths, size, what, together, bad):
            file.write(part.data)

    return write


def _decoded_chunks(
    paths: Sequence[Path], size: ImageSize, what: str, together: Together, bad: dict[int, str]
) -> Iterator[tuple[int, UInt8[ndarray, "k h w c"]]]:
    """Images by chunk, with the index of the first; those that cannot be decoded are black and noted in ``bad``."""
    notify = notify_every(5.0, f"decoding {what}")

    def all_files() -> Iterator[Path]:
        yield from together.paths()  # listed only if a deeper picture is met

    levels = WhiteLevels(all_files(), together.name)

    def decode(i: int) -> ndarray:
        try:
            return decode_image(paths[i], size.height, size.width, size.channels, levels)
        except UnreadableImageError as error:
            bad[i] = str(error)
            return np.zeros((size.height, size.width, size.channels), np.uint8)

    with warnings.catch_warnings(), ThreadPoolExecutor(os.cpu_count()) as pool:  # Pillow decodes outside the GIL
        warnings.simplefilter("ignore")  # Pillow warns of large images and odd metadata; its limit holds
        for start in range(0, len(paths), CHUNK):
            yield start, np.stack(list(pool.map(decode, range(start, min(start + CHUNK, len(paths))))))
            notify(min(start + CHUNK, len(paths)), len(paths))
