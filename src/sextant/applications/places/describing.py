"""Photos as descriptors of a trained network; one that cannot be read is named, and the rest go on."""

import os
import warnings
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from jaxtyping import Float32, Int64, UInt8
from numpy import ndarray
from PIL import Image

from sextant.applications.places.photo_folder import PhotoFolder
from sextant.data import upright
from sextant.data.places.decoded_images import ImageSize
from sextant.data.places.image_files import UnreadableImageError, decode_image
from sextant.data.unusable_files import nothing_usable
from sextant.retrieval.flat_index import FlatIndex

BATCH = 64
#: width over height, of the photo and as the network sees it: beyond this ratio a photo is named as stretched
LARGEST_STRETCH = 1.4
Progress = Callable[[int, int], None]


class PlaceDescriber(Protocol):
    """A trained network, as far as matching needs it.

    Attributes:
        size: of its images.
        model: what tells it from other networks.
    """

    @property
    def size(self) -> ImageSize: ...  # noqa: D102
    @property
    def model(self) -> str: ...  # noqa: D102

    def describe(self, images: UInt8[ndarray, "b h w c"]) -> Float32[ndarray, "b d"]:
        """Descriptors of images of bytes."""


@dataclass(frozen=True)
class DescribedPhotos:
    """Photos of a folder with their descriptors.

    Attributes:
        photos: all of them.
        index: descriptors of those that could be described, in the same order, with their names.
        failed: why the others could not, by name.
        stretched: names of photos whose shape is far from that of the network's images.
    """

    photos: PhotoFolder
    index: FlatIndex
    failed: Mapping[str, str]
    stretched: tuple[str, ...]

    @property
    def rows(self) -> Int64[ndarray, "n"]:
        """Which of the photos have a descriptor."""
        return np.array([i for i, name in enumerate(self.photos.names) if name not in self.failed], np.int64)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the photos that have a descriptor."""
        return tuple(self.photos.names[i] for i in self.rows)


def describe_photos(network: PlaceDescriber, photos: PhotoFolder, key: str, progress: Progress) -> DescribedPhotos:
    """Describe all photos of a folder; they are decoded as images of training are, and stretched to the same size.

    Args:
        network: gives the descriptors.
        photos: the files.
        key: of the argument that named them, for messages.
        progress: called with the photos done and all.

    Raises:
        UserError: not one photo could be described.
    """
    failed: dict[str, str] = {}
    stretched: list[str] = []
    parts: list[ndarray] = []
    done = 0
    for names, images in _decoded(photos, network.size, failed, stretched):
        if names:
            found = network.describe(images)
            good = np.isfinite(found).all(axis=1)
            failed |= {
                name: "the network gives no finite descriptor" for name, ok in zip(names, good, strict=True) if not ok
            }
            parts.append(found[good])
        done = min(done + BATCH, len(photos))
        progress(done, len(photos))
    if len(failed) == len(photos):
        raise nothing_usable(f"{key}={photos.folder}: none of {len(photos):,} photos can be used", failed)
    kept = [name for name in photos.names if name not in failed]
    return DescribedPhotos(photos, FlatIndex(np.concatenate(parts), names=kept), failed, tuple(stretched))


def _decoded(
    photos: PhotoFolder, size: ImageSize, failed: dict[str, str], stretched: list[str]
) -> Iterator[tuple[list[str], UInt8[ndarray, "b h w c"]]]:
    """Names and images batch by batch; what cannot be decoded is put into ``failed``."""
    aspect = size.width / size.height

    def decode(name: str) -> tuple[ndarray | str, bool]:
        path = photos.folder / name
        try:
            image = decode_image(path, size.height, size.width, size.channels)
        except UnreadableImageError as error:
            return str(error), False
        width, height = upright_size(path)
        ratio = width / height / aspect
        return image, max(ratio, 1 / ratio) > LARGEST_STRETCH

    with warnings.catch_warnings(), ThreadPoolExecutor(os.cpu_count()) as pool:  # Pillow decodes outside the GIL
        warnings.simplefilter("ignore")  # Pillow warns of large images and odd metadata; its limit holds
        for start in range(0, len(photos), BATCH):
            batch = photos.names[start : start + BATCH]
            names, images = [], []
            for name, (found, far) in zip(batch, pool.map(decode, batch), strict=True):
                if isinstance(found, str):
                    failed[name] = found
                    continue
                names.append(name)
                images.append(found)
                if far:
                    stretched.append(name)
            yield names, np.stack(images) if images else np.empty((0,), np.uint8)


def upright_size(path: Path) -> tuple[int, int]:
    """Width and height of an image file that can be decoded, upright; from its header alone."""
    with Image.open(path) as image:
        return upright.upright_size(image)
