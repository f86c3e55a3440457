"""Small pictures of a map's images, saved beside it to show the place that a localizer estimates."""

from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from sextant.array_folder import FolderFormat
from sextant.atomic_files import hash_file, write_atomically
from sextant.chapters.places.data.image_rows import ImageRows
from sextant.tables import counted

KIND = FolderFormat("a set of pictures", "sextant.map_pictures", 1, "pictures.json")
ARRAY = "pictures.npy"
#: rows of a picture, and bytes of all pictures of a map; a map that would exceed these gets none
ROWS, MOST_BYTES = 96, 64_000_000


def thumbnail(image: UInt8[ndarray, "h w c"], rows: int = ROWS) -> UInt8[ndarray, "k l c"]:
    """An image scaled down to at most ``rows`` rows, with its aspect preserved.

    >>> thumbnail(np.zeros((480, 640, 3), np.uint8)).shape
    (96, 128, 3)
    """
    height, width, channels = image.shape
    if height <= rows:
        return image
    size = max(1, round(width * rows / height)), rows
    picture = Image.fromarray(image[..., 0] if channels == 1 else image).resize(size, Image.Resampling.BOX)
    return np.asarray(picture).reshape(*size[::-1], channels)


def map_pictures(images: UInt8[ndarray, "n h w c"] | ImageRows) -> UInt8[ndarray, "n k l c"] | None:
    """Thumbnails of a map's images; None if they would take more than 64 MB.

    Args:
        images: images of the map, in its order; read one by one.
    """
    if len(images) == 0 or len(images) * thumbnail(images[0]).nbytes > MOST_BYTES:
        return None
    return np.stack([thumbnail(images[number]) for number in range(len(images))])


def save_pictures(pictures: UInt8[ndarray, "n h w c"] | None, folder: Path) -> None:
    """Write the pictures, the header last; None deletes existing ones.

    Raises:
        OSError: the folder cannot be written to.
    """
    (folder / KIND.header).unlink(missing_ok=True)
    if pictures is None:
        (folder / ARRAY).unlink(missing_ok=True)
        return
    write_atomically(folder / ARRAY, partial(np.save, arr=pictures, allow_pickle=False))
    KIND.write_header(folder, {"sha256": hash_file(folder / ARRAY)})


def load_pictures(folder: Path, images: int, *, verify: bool = True) -> UInt8[ndarray, "n h w c"] | None:
    """Open the pictures that :func:`save_pictures` wrote, memory-mapped; None if there are none, as in older maps.

    Args:
        folder: folder that they were written into.
        images: number of images of the map.
        verify: check the hash of the file.

    Raises:
        UserError: the pictures are damaged.
    """
    if not (folder / KIND.header).is_file():
        return None
    sha256 = str(KIND.read_header(folder).get("sha256"))
    pictures = KIND.open_array(folder, folder / ARRAY, "r", sha256=sha256 if verify else None)
    if pictures.dtype != np.uint8 or pictures.ndim != 4 or len(pictures) != images:
        raise KIND.damaged(folder, f"{ARRAY} holds {pictures.dtype} {pictures.shape} for {counted(images, 'image')}")
    return pictures
