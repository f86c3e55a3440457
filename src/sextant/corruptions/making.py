"""Corrupted copies of a set of images as files, in the layout of CIFAR-10-C.

There is one ``.npy`` file per corruption, uint8 of shape ``(s·n, ...)``: all n images at the first severity, then all
at the next. ``labels.npy`` repeats the labels in the same way, as often as the largest file needs. ``corruptions.json``
records what the files were made from; complete files made from the same are kept, so that an interrupted run resumes.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import torch
from numpy.typing import NDArray

from sextant.atomic_files import read_json, write_atomically, write_json
from sextant.corruptions.benchmark_corruption import BenchmarkCorruption, Mode
from sextant.corruptions.pixels import to_bytes
from sextant.errors import UserError
from sextant.user_files import absent

Images = NDArray[np.uint8]
Corruptions = Mapping[str, BenchmarkCorruption[Any, Any]]
Advance = Callable[[int], None]

RECORD, LABELS = "corruptions.json", "labels.npy"
#: first bytes of a ``.npy`` file
MAGIC = b"\x93NUMPY"
BLOCK_BYTES, BLOCK_IMAGES = 2**23, 256  # worked on at once, as floats


@dataclass(frozen=True)
class Recipe:
    """The settings shared by all files of a folder.

    Attributes:
        set: name of the set of parameters.
        mode: mode of the corruptions and of the rounding to 8 bits.
        seed: seed of all random draws.
        images: identity of the clean images: :func:`images_digest`.
        version: version of the program.
    """

    set: str
    mode: Mode
    seed: int
    images: str
    version: str


def read_array(path: Path, name: str) -> NDArray[Any]:
    """A ``.npy`` file, mapped into memory; nothing in it is unpickled.

    Args:
        path: path of the file.
        name: its name in error messages.

    Raises:
        UserError: the file does not exist, or is not a complete array of numbers.
    """
    try:
        with path.expanduser().open("rb") as file:
            if file.read(len(MAGIC)) not in (MAGIC, b""):
                raise UserError(f"{name} cannot be read: it is not a .npy file", "numpy.save writes one.")
        loaded = np.load(path.expanduser(), mmap_mode="r", allow_pickle=False)
    except FileNotFoundError:
        raise UserError(f"{name}: {absent(path.expanduser())}") from None
    except (OSError, ValueError, EOFError) as error:
        reason = str(error).splitlines()[0] if str(error) else "it is cut off"
        raise UserError(f"{name} cannot be read: {reason}", "It must be a complete .npy file of numbers.") from None
    return np.asanyarray(loaded)


def images_digest(images: Images) -> str:
    """SHA-256 of the shape and the values, read block by block."""
    digest = hashlib.sha256(str(images.shape).encode())
    for start, stop in _blocks(images):
        digest.update(np.ascontiguousarray(images[start:stop]).data)
    return digest.hexdigest()


def check_images(images: NDArray[Any], name: str) -> Images:
    """``images`` if they can be corrupted: uint8, (n, h, w), (n, h, w, 1) or (n, h, w, 3), not empty.

    Args:
        images: an array.
        name: its name in error messages.

    Raises:
        UserError: they cannot.
    """
    allowed = "Images are uint8 of shape (n, height, width), (n, height, width, 1) or (n, height, width, 3)."
    if images.dtype != np.uint8:
        raise UserError(f"{name} holds {images.dtype}, not uint8", allowed)
    if images.ndim == 3 and images.shape[2] == 3:
        raise UserError(f"{name} has the shape {images.shape}, that of one colour image", "Add an axis: images[None].")
    if images.ndim not in (3, 4) or (images.ndim == 4 and images.shape[3] not in (1, 3)) or images.size == 0:
        raise UserError(f"{name} has the shape {images.shape}", allowed)
    return images


def check_labels(labels: NDArray[Any], name: str, count: int) -> NDArray[Any]:
    """``labels`` as bytes where they fit, else as 64-bit integers.

    Raises:
        UserError: they are not one whole number for each of ``count`` images.
    """
    if labels.shape != (count,) or labels.dtype.kind not in "iu":
        raise UserError(
            f"{name} holds {labels.dtype} of shape {labels.shape}", f"Labels are whole numbers of shape ({count},)."
        )
    return labels.astype(np.uint8 if labels.min() >= 0 and labels.max() < 256 else np.int64)


def is_whole(path: Path, shape: tuple[int, ...]) -> bool:
    """Whether ``path`` is a complete ``.npy`` file of uint8 of ``shape``."""
    try:
        stored = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError):
        return False
    return bool(stored.dtype == np.uint8 and stored.shape == shape)


def missing(folder: Path, corruptions: Corruptions, images: Images) -> dict[str, int]:
    """The corruptions whose file in ``folder`` is still to be made, and its size in bytes."""
    sizes = {name: images.size * len(c.levels) for name, c in corruptions.items()}
    return {
        name: size
        for name, size in sizes.items()
        if not is_whole(folder / f"{name}.npy", _shape(images, len(corruptions[name].levels)))
    }


def begin(folder: Path, recipe: Recipe, corruptions: Corruptions) -> None:
    """Record in ``folder`` what its files are made from, and remove what an interrupted run left half-written.

    Raises:
        UserError: it holds corruptions that were made from something else, or at other severities.
        OSError: it cannot be written to.
    """
    levels = {name: list(c.levels) for name, c in corruptions.items()}
    before = read_json(folder / RECORD)
    if isinstance(before, dict):
        old, new = dict(before.get("recipe") or {}), asdict(recipe)
        old_levels = dict(before.get("severities") or {})
        other = [key for key in new if old.get(key) != new[key]]
        other += [f"severities of {name}" for name in levels if old_levels.get(name, levels[name]) != levels[name]]
        if other:
            raise UserError(
                f"{folder} holds corruptions that differ in {', '.join(other)}",
                f"Choose another folder with output=, or delete this one. Its contents: {folder / RECORD}",
            )
        levels = old_levels | levels
    elif strangers := [name for name in levels if (folder / f"{name}.npy").exists()]:
        raise UserError(
            f"{folder} holds {strangers[0]}.npy, but no readable {RECORD}, which records how it was made",
            "Choose another folder with output=, or delete this one.",
        )
    write_json(folder / RECORD, {"recipe": asdict(recipe), "severities": levels})
    for name in corruptions:  # others may be in progress elsewhere
        for path in folder.glob(f".{name}.npy.*.tmp"):
            path.unlink(missing_ok=True)


def require_same_labels(folder: Path, labels: NDArray[Any]) -> None:
    """Raise a ``UserError`` if the folder has other labels; a file that cannot be read holds none."""
    try:
        before = np.load(folder / LABELS, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError):
        return
    if not np.array_equal(np.atleast_1d(before)[: len(labels)], labels):
        raise UserError(
            f"{folder / LABELS} has other labels", "Choose another folder with output=, or delete that file."
        )


def write_labels(folder: Path, labels: NDArray[Any], repeats: int) -> None:
    """Write the labels as often as the largest file has severities."""
    write_atomically(folder / LABELS, lambda file: np.save(file, np.tile(labels, repeats), allow_pickle=False))


def write_corruption(
    path: Path,
    corruption: BenchmarkCorruption[Any, Any],
    images: Images,
    recipe: Recipe,
    device: torch.device | str = "cpu",
    advance: Advance = lambda images: None,
) -> None:
    """Corrupt ``images`` at every severity and write them to ``path``, whole or not at all.

    Images are read, corrupted and written block by block, never all at once.

    Args:
        path: path of the file.
        corruption: the corruption to apply.
        images: clean images, uint8, (n, h, w) or (n, h, w, c); may be a memory map.
        recipe: its mode and seed are used.
        device: where to compute.
        advance: called after each block with its number of images.

    Raises:
        OSError: the disk is full or cannot be written to.
    """
    shape = _shape(images, len(corruption.levels))

    def write(file: BinaryIO) -> None:
        np.lib.format.write_array_header_1_0(file, _header(shape))
        for level in corruption.levels:
            for start, stop in _blocks(images):
                file.write(_corrupted(corruption, level, images[start:stop], start, recipe, device).data)
                advance(stop - start)

    write_atomically(path, write)


def _corrupted(
    corruption: BenchmarkCorruption[Any, Any],
    level: float,
    images: Images,
    first: int,
    recipe: Recipe,
    device: torch.device | str,
) -> Images:
    """A block of images whose first has the index ``first``."""
    stacked = images[..., None] if images.ndim == 3 else images
    values = torch.from_numpy(np.ascontiguousarray(stacked.transpose(0, 3, 1, 2))).to(device).float() / 255
    indices = torch.arange(first, first + len(images))
    result = to_bytes(corruption(values, level, indices, recipe.seed), recipe.mode)
    return np.ascontiguousarray(result.permute(0, 2, 3, 1).cpu().numpy().reshape(images.shape))


def _shape(images: Images, severities: int) -> tuple[int, ...]:
    return (severities * len(images), *images.shape[1:])


def _blocks(images: Images) -> list[tuple[int, int]]:
    """Ranges of images that are processed at once."""
    size = max(1, min(BLOCK_IMAGES, BLOCK_BYTES // (4 * images[0].size)))
    return [(start, min(start + size, len(images))) for start in range(0, len(images), size)]


def _header(shape: tuple[int, ...]) -> dict[str, Any]:
    return {"descr": np.lib.format.dtype_to_descr(np.dtype(np.uint8)), "fortran_order": False, "shape": shape}
