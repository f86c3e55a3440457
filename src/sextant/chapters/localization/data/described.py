"""Descriptors of the images of a drive, computed once and kept on disk.

All runs of a sweep use the same images with the same descriptor. The descriptors of a drive are a file in the cache,
named by a hash of the descriptor's identity, the dataset's fingerprint and the drive. It is written whole or not at
all, and memory-mapped.
"""

import hashlib
import json
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Float32
from numpy import ndarray
from numpy.lib import format as npy

from sextant.chapters.localization.data.drive import Drive
from sextant.chapters.places.data.image_rows import ImageRows
from sextant.chapters.places.descriptors import Describer
from sextant.errors import UserError
from sextant.kept_array import keep_array, open_kept
from sextant.reporter import SILENT, Advance

#: images read and described at a time; in colour at 64x96 pixels they take 18 MB
BATCH = 1024
#: makes a progress display with the given title
Showing = Callable[[str], AbstractContextManager[Advance]]


def silent(title: str) -> AbstractContextManager[Advance]:
    """A progress display that shows nothing."""
    return SILENT.progress(title, "images")


class DescribedDrives:
    """The descriptors of the drives of a dataset.

    Args:
        describer: of the images.
        dataset: fingerprint of the dataset.
        cache: folder to keep them in.
        show: makes the progress display of one drive.
    """

    def __init__(self, describer: Describer, dataset: str, cache: Path, show: Showing = silent):
        self.describer, self.dataset, self.cache, self.show = describer, dataset, cache, show
        self._fitted = False

    def fit(self, drive: Drive) -> None:
        """Fit the describer to the images of a map when the first descriptor is requested."""
        self._map, self._fitted = drive, False

    def of(self, drive: Drive) -> Float32[ndarray, "n d"]:
        """Descriptors of all images of a drive, memory-mapped from the cache.

        Raises:
            UserError: the drive has no images, or the cache cannot be written to.
        """
        if drive.images is None:
            raise UserError(f"the drive {drive.name} has no images", "descriptor=files reads descriptors of your own.")
        path, shape = self.cache / f"descriptors-{self._key(drive)}.npy", (len(drive.images), None)
        found = open_kept(path, shape, np.float32)
        if found is None:
            self._write(drive, path)
            found = open_kept(path, shape, np.float32)
            assert found is not None
        return np.asarray(found)

    def _key(self, drive: Drive) -> str:
        assert drive.images is not None
        assert self._map.images is not None
        facts = [self.describer.identity, self.dataset, drive.name, drive.condition, drive.images.shape]
        facts += [altered] if (altered := drive.images.altered) else []
        hashed = hashlib.sha256(json.dumps(facts).encode())
        for images in (self._map.images, drive.images):
            hashed.update(np.ascontiguousarray(images.rows).tobytes())
        return hashed.hexdigest()[:16]

    def _write(self, drive: Drive, path: Path) -> None:
        assert drive.images is not None
        assert self._map.images is not None
        if not self._fitted:
            self.describer.fit(self._map.images)
            self._fitted = True
        try:
            with self.show(f"describing {drive.name}") as progress:
                keep_array(path, partial(self._describe, drive.images, progress))
        except OSError as error:
            raise UserError(
                f"{path.parent}: descriptors cannot be stored there: {error}", "paths.cache=<folder>"
            ) from None

    def _describe(self, images: ImageRows, progress: Advance, file: BinaryIO) -> None:
        for start in range(0, len(images), BATCH):
            found = np.ascontiguousarray(self.describer.describe(images[start : start + BATCH]), np.float32)
            if start == 0:
                npy.write_array_header_1_0(
                    file, {"descr": "<f4", "fortran_order": False, "shape": (len(images), found.shape[1])}
                )
            file.write(found.data)
            progress(start + len(found), len(images))
