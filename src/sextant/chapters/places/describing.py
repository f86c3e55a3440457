"""Computing descriptors of photos; a photo that cannot be read is named, and the others are still described."""

import os
import warnings
from collections.abc import Iterator, Mapping, Sequence, Set
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float32, Float64, Int64, UInt8
from numpy import ndarray

from sextant.applications.pixels import detached
from sextant.chapters.places.data.decoded_images import ImageSize
from sextant.chapters.places.photo_folder import PhotoFolder
from sextant.chapters.places.saved_descriptor import Describes
from sextant.data import upright
from sextant.data.image_files import decode_image
from sextant.data.picture_files import UnreadableImageError, open_picture
from sextant.data.pixel_values import WhiteLevels, levels_of_folders
from sextant.errors import ArgumentError, shown
from sextant.reporter import Advance
from sextant.retrieval.flat_index import FlatIndex
from sextant.tables import counted

BATCH = 64
#: ratio of a photo's aspect to that of the network's images, or its inverse, above which it is reported as stretched
LARGEST_STRETCH = 1.4


class Described(NamedTuple):
    """The outcome of describing photos, which are numbered from 0.

    Attributes:
        rows: descriptors of the photos that could be described, in their order.
        failed: why the others could not be described, by number.
        stretched: numbers of photos whose aspect is far from that of the network's images.
    """

    rows: Float32[ndarray, "n d"]
    failed: Mapping[int, str]
    stretched: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class DescribedPhotos:
    """Photos of a folder with their descriptors.

    Attributes:
        photos: all photos.
        index: descriptors of the photos that could be described, in the same order, with their names.
        failed: why the others could not be described, by name.
        stretched: names of photos whose aspect is far from that of the network's images.
        positions: x and y in metres of the photos that could be described; nan where unknown.
    """

    photos: PhotoFolder
    index: FlatIndex
    failed: Mapping[str, str]
    stretched: tuple[str, ...]
    positions: Float64[ndarray, "n 2"] | None = None

    @property
    def rows(self) -> Int64[ndarray, "n"]:
        """Which of the photos have a descriptor."""
        return np.array([i for i, name in enumerate(self.photos.names) if name not in self.failed], np.int64)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the photos that have a descriptor."""
        return tuple(self.photos.names[i] for i in self.rows)

    @property
    def paths(self) -> list[Path]:
        """Files of the photos that have a descriptor."""
        return [self.photos.folder / name for name in self.names]

    def facts(self) -> dict[str, Any]:
        """Plain values: the folder, how many photos could be described, and which could not."""
        return {
            "folder": str(self.photos.folder),
            "photos": len(self.photos),
            "described": len(self.index),
            "failed": [{"photo": name, "error": why} for name, why in self.failed.items()],
            "stretched": list(self.stretched),
        }


def joined(parts: Sequence[DescribedPhotos]) -> DescribedPhotos:
    """Join the photos of several folders, with names relative to their common folder."""
    if len(parts) == 1:
        return parts[0]
    folders = [os.path.abspath(part.photos.folder) for part in parts]
    folder = os.path.commonpath(folders)
    within = [Path(os.path.relpath(each, folder)) for each in folders]

    def named(names: Sequence[str], of: int) -> list[str]:
        return [(within[of] / name).as_posix() for name in names]

    each = list(enumerate(parts))
    names = [name for i, part in each for name in named(part.names, i)]
    places = [np.full((len(p.index), 2), np.nan) if p.positions is None else p.positions for p in parts]
    return DescribedPhotos(
        PhotoFolder(Path(folder), tuple(name for i, part in each for name in named(part.photos.names, i))),
        FlatIndex.joined([part.index for part in parts], names),
        {
            name: why
            for i, part in each
            for name, why in zip(named(list(part.failed), i), part.failed.values(), strict=True)
        },
        tuple(name for i, part in each for name in named(part.stretched, i)),
        None if all(part.positions is None for part in parts) else np.concatenate(places),
    )


def without_failed(described: DescribedPhotos, files: Set[Path]) -> DescribedPhotos:
    """The same photos without those in ``files`` that could not be described."""
    again = {name for name in described.failed if (described.photos.folder / name).absolute() in files}
    if not again:
        return described
    names = tuple(name for name in described.photos.names if name not in again)
    failed = {name: why for name, why in described.failed.items() if name not in again}
    return replace(described, photos=PhotoFolder(described.photos.folder, names), failed=failed)


def describe(
    describer: Describes,
    size: ImageSize,
    photos: Sequence[Path | UInt8[ndarray, "h w c"]],
    progress: Advance = lambda done, total: None,
    among: Sequence[Path] | None = None,
) -> Described:
    """Describe photos; files are decoded like training images and stretched to one size.

    Pictures of more than 8 bits share the white level of all files in their folders, whichever of them are given.

    Args:
        describer: computes the descriptors.
        size: size of the images that it takes.
        photos: files, or bytes of that size.
        progress: called with the number of photos done and the total.
        among: all photos of which these are a part, whose folders share a white level; None if they are all.

    Raises:
        ArgumentError: the describer does not return one row of numbers per image.
    """
    failed: dict[int, str] = {}
    stretched: list[int] = []
    files = [photo for photo in photos if isinstance(photo, Path)] if among is None else among
    levels = levels_of_folders(dict.fromkeys(path.absolute().parent for path in files))
    parts: list[ndarray] = []
    done = 0
    for numbers, images in _decoded(photos, size, levels, failed, stretched):
        if numbers:
            found = _described(describer, images)
            good = np.isfinite(found).all(axis=1)
            failed |= {
                number: "the network's descriptor is not finite"
                for number, ok in zip(numbers, good, strict=True)
                if not ok
            }
            parts.append(found[good])
        done = min(done + BATCH, len(photos))
        progress(done, len(photos))
    return Described(np.concatenate(parts) if parts else np.empty((0, 0), np.float32), failed, tuple(stretched))


def _described(describer: Describes, images: UInt8[ndarray, "b h w c"]) -> Float32[ndarray, "b d"]:
    found = describer.describe(images)
    try:
        rows = np.asarray(detached(found), np.float32)
        told = f"an array of the shape {rows.shape}"
    except (TypeError, ValueError, RuntimeError):
        rows, told = np.empty(0, np.float32), shown(found)
    if rows.ndim != 2 or len(rows) != len(images):
        raise ArgumentError(
            f"descriptor: {type(describer).__name__}.describe returned {told} for {counted(len(images), 'image')}",
            "It must return one row of numbers for each image.",
        )
    return rows


def _decoded(
    photos: Sequence[Path | ndarray],
    size: ImageSize,
    levels: WhiteLevels,
    failed: dict[int, str],
    stretched: list[int],
) -> Iterator[tuple[list[int], UInt8[ndarray, "b h w c"]]]:
    """Numbers and images batch by batch; why a photo cannot be decoded is put into ``failed``."""
    aspect = size.width / size.height

    def decode(photo: Path | ndarray) -> tuple[ndarray | str, bool]:
        if isinstance(photo, ndarray):
            return photo, False
        if not photo.is_file():
            absent = "is a broken link" if photo.is_symlink() else "there is no such file"
            return ("is a folder, not a file" if photo.is_dir() else absent), False
        try:
            image = decode_image(photo, size.height, size.width, size.channels, levels)
        except UnreadableImageError as error:
            return str(error), False
        width, height = upright_size(photo)
        ratio = width / height / aspect
        return image, max(ratio, 1 / ratio) > LARGEST_STRETCH

    with warnings.catch_warnings(), ThreadPoolExecutor(os.cpu_count()) as pool:  # Pillow decodes outside the GIL
        warnings.simplefilter("ignore")  # Pillow warns of large images and odd metadata; its hard limit still applies
        for start in range(0, len(photos), BATCH):
            numbers, images = [], []
            for number, (found, far) in enumerate(pool.map(decode, photos[start : start + BATCH]), start):
                if isinstance(found, str):
                    failed[number] = found
                    continue
                numbers.append(number)
                images.append(found)
                if far:
                    stretched.append(number)
            yield numbers, np.stack(images) if images else np.empty((0,), np.uint8)


def upright_size(path: Path) -> tuple[int, int]:
    """Width and height of a decodable image file, upright; only the header is read."""
    with open_picture(path) as image:
        return upright.upright_size(image)
