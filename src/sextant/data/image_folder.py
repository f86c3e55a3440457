"""The user's own images: a folder with one sub-folder per class."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image, ImageOps

from sextant.data.file_kinds import is_hidden
from sextant.data.image_files import SUFFIXES, require_sides
from sextant.data.photo_files import image_paths
from sextant.data.picture_files import open_picture, why_unreadable
from sextant.data.pixel_values import WhiteLevels, eight_bits, without_alpha
from sextant.data.source import (
    SPLITS,
    ImageSource,
    ImageSpec,
    LabelledImages,
    MissingDataError,
    Split,
    channels_first,
    first_folder,
)
from sextant.data.upright import upright
from sextant.errors import ArgumentError, UserError
from sextant.tables import counted

LARGEST_IN_MEMORY = 8 * 2**30


class ImageFolder(ImageSource):
    """Images in ``folder/<class>/*``, or ``folder/train/<class>/*`` and ``folder/test/<class>/*``.

    Images are turned upright by their EXIF orientation, scaled so that they cover a square and cropped at its centre.
    Without ``train`` and ``test`` folders, a fixed permutation of each class puts a share into the test split.

    Args:
        folder: the folder, absolute, or relative to the working directory or one of the ``roots``.
        size: side of the square images in pixels.
        channels: 3 for colour, 1 for grey.
        test_fraction: share of each class in the test split when the folder has none, in (0, 1).
        crop: share of an image's shorter side that the square covers, such as 0.875 for ImageNet; null for all.
        roots: further folders to search.
    """

    name = "image_folder"

    def __init__(
        self,
        folder: str,
        size: int = 64,
        channels: int = 3,
        test_fraction: float = 0.2,
        crop: float | None = None,
        roots: Sequence[Path | str] = (),
    ):
        looked = [Path(folder).expanduser().absolute(), *(Path(root) / folder for root in roots)]
        self.folder = next((path for path in looked if path.is_dir()), None)
        self.looked = looked
        self.size, self.channels, self.test_fraction, self.crop = size, channels, test_fraction, crop or 1.0

    def _classes(self) -> list[str]:
        root = self._root()
        base = root / "train" if self._has_splits() else root
        classes = _folders_of_images(base)
        if len(classes) < 2:
            raise MissingDataError(
                f"folder={root}: {counted(len(classes), 'folder')} with images, need one for each of at least two "
                "classes",
                f"Arrange the images as {base}/<class>/<image>{SUFFIXES[0]}",
            )
        if self._has_splits() and (unknown := set(_folders_of_images(root / "test")) - set(classes)):
            raise ArgumentError(
                f"folder={root}: test has {', '.join(sorted(unknown))}, which train lacks",
                f"The classes of train are {', '.join(classes)}: rename or remove the other folders.",
            )
        return classes

    def _root(self) -> Path:
        fix = "Give a folder with one sub-folder a class: folder=/path/to/images. Without images of your own: "
        return first_folder(self.looked, "folder", f"{fix}dataset=digits")

    def _has_splits(self) -> bool:
        return all((self._root() / split).is_dir() for split in ("train", "test"))

    def files(self, split: Split) -> list[Path]:
        """The images of ``split``, class by class, each class in the order of its file names."""
        chosen: list[Path] = []
        for label, name in enumerate(self._classes()):
            if self._has_splits():
                chosen += sorted(_images(self._root() / split / name))
                continue
            paths = sorted(_images(self._root() / name))
            order = np.random.default_rng(label).permutation(len(paths))
            if len(paths) < 2:
                raise ArgumentError(f"folder={self.folder}: class {name} has one image, too few for two splits")
            tests = max(1, round(self.test_fraction * len(paths)))
            chosen += [paths[i] for i in sorted(order[:tests] if split == "test" else order[tests:])]
        return chosen

    def spec(self) -> ImageSpec:
        """A square of the configured size; classes are the folder names in order."""
        return ImageSpec(self.channels, self.size, self.size, tuple(self._classes()))

    def count(self, split: Split) -> int:
        """Number of files of ``split``."""
        return len(self.files(split))

    def read(self, split: Split) -> LabelledImages:
        """Decode a split.

        Raises:
            UserError: an image cannot be decoded (the message names it), or the split does not fit into memory.
        """
        paths = self.files(split)
        if not paths:
            raise ArgumentError(f"folder={self.folder}: no image of {self._classes()} in its {split} folder")
        needed = len(paths) * self.channels * self.size**2
        if needed > LARGEST_IN_MEMORY:
            raise ArgumentError(
                f"folder={self.folder}: {counted(len(paths), 'image')} of {self.size}x{self.size} pixels need "
                f"{needed / 2**30:.1f} GiB of memory",
                f"Use smaller images, for example size={self.size // 2}",
            )
        levels = WhiteLevels((path for each in SPLITS for path in self.files(each)), str(self.folder))
        with ThreadPoolExecutor() as pool:  # Pillow decodes outside the interpreter lock
            images = list(
                pool.map(lambda path: decode_square(path, self.size, self.channels, levels, self.crop), paths)
            )
        index = {name: label for label, name in enumerate(self._classes())}
        labels = np.array([index[path.parent.name] for path in paths], np.int64)
        return LabelledImages(channels_first(np.stack(images)), labels)


def decode_square(
    path: Path, size: int, channels: int, levels: WhiteLevels | None = None, crop: float = 1.0
) -> UInt8[ndarray, "h w *c"]:
    """:func:`decode_covering` for a square of ``size`` pixels, which covers the share ``crop`` of the shorter side."""
    return decode_covering(path, (size, size), channels, levels, crop)


def decode_covering(
    path: Path, size: tuple[int, int], channels: int, levels: WhiteLevels | None = None, crop: float = 1.0
) -> UInt8[ndarray, "h w *c"]:
    """An image turned upright, scaled to cover ``size`` (height and width) and cropped at its centre.

    Transparent pixels become black, and more than 8 bits become 8 by the white level of ``levels``; without, by that of
    the files of its folder.

    Raises:
        UserError: it cannot be decoded; the message names the file.
    """
    try:
        with open_picture(path) as image:
            require_sides(image)
            return covering_bytes(image, size, channels, path, levels, crop)
    except Exception as error:  # Pillow's decoders raise errors of any kind for a damaged file
        raise UserError(
            f"{path} {why_unreadable(path, error)}", "Replace the file or take it out of the folder."
        ) from None


def covering_bytes(
    image: Image.Image,
    size: tuple[int, int],
    channels: int,
    path: Path | None = None,
    levels: WhiteLevels | None = None,
    crop: float = 1.0,
) -> UInt8[ndarray, "h w *c"]:
    """An open picture, decoded as in :func:`decode_covering`.

    Raises:
        ValueError: the white level of its values is unknown.
    """
    picture = without_alpha(upright(eight_bits(image, path, levels))).convert("RGB" if channels == 3 else "L")
    return np.asarray(ImageOps.fit(picture, size[::-1], Image.Resampling.BICUBIC, bleed=(1 - crop) / 2))


def _folders_of_images(base: Path) -> list[str]:
    inside = (path for path in base.iterdir() if path.is_dir() and not is_hidden(path.name))
    return sorted(path.name for path in inside if any(_images(path)))


def _images(folder: Path) -> list[Path]:
    return list(image_paths(folder, deep=False)) if folder.is_dir() else []
