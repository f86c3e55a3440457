"""A folder of the user's own panoramas: images twice as wide as high."""

import hashlib
import json
import os
import re
import warnings
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from sextant.atomic_files import file_sha256
from sextant.chapters.calibration.data.panoramas import SPLITS, Panoramas, Split
from sextant.data.image_files import SUFFIXES
from sextant.data.photo_files import image_paths
from sextant.data.picture_files import open_picture, why_unreadable
from sextant.data.pixel_values import LEVELS, WhiteLevels, eight_bits, is_deep, without_alpha
from sextant.data.rendered.disk import reporting_disk_errors
from sextant.data.rendered.lock import notify_every
from sextant.data.source import MissingDataError, first_folder
from sextant.data.upright import upright, upright_size
from sextant.errors import ArgumentError
from sextant.kept_array import keep_array, open_kept
from sextant.tables import counted

#: width over height may differ from 2 by this share
TOLERANCE = 0.01
SMALLEST_HEIGHT = 32


class UnfitImageError(Exception):
    """The file is not a panorama; the message says why, without the file's name."""


def decode_panorama(path: Path, height: int, levels: WhiteLevels | None = None) -> UInt8[ndarray, "height 2*height 3"]:
    """A panorama, turned upright by its EXIF orientation and scaled to ``height`` rows.

    Grey, palette and CMYK images become RGB, deeper images are reduced to 8 bits by the white level of ``levels``, and
    transparent pixels become black. JPEG files are decoded at 1/2, 1/4 or 1/8 of their size where that is enough.

    Raises:
        UnfitImageError: it cannot be decoded, has too many pixels, or is not twice as wide as high.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns of sizes common for panoramas; its hard limit applies
            with open_picture(path) as image:
                _check_shape(image)
                image.draft("RGB", (2 * height, height))
                picture = without_alpha(upright(eight_bits(image, path, levels))).convert("RGB")
                return np.asarray(picture.resize((2 * height, height), Image.Resampling.LANCZOS, reducing_gap=3.0))
    except UnfitImageError:
        raise
    except Exception as error:  # Pillow's decoders may raise anything on a damaged file
        raise UnfitImageError(why_unreadable(path, error)) from None


def _check_shape(image: Image.Image) -> None:
    width, height = upright_size(image)
    if abs(width / (2 * height) - 1) > TOLERANCE:
        raise UnfitImageError(f"is {width} x {height} pixels, but a full panorama is twice as wide as high")
    if height < SMALLEST_HEIGHT:
        raise UnfitImageError(f"is {width} x {height} pixels, but needs at least {SMALLEST_HEIGHT} rows")


#: changes when the same files would be decoded into other pixels
DECODER = 1
#: bad files that a message names
NAMED = 20


class PanoramaFolder:
    """All panoramas below a folder, split by scene.

    A scene is the match of ``groups`` in a file's path. Without ``groups``, it is the part of the name before ``__`` if
    that is one of ``together``, otherwise the file itself. No scene is in two splits. Images are scaled to one height
    and cached, so that each is decoded only once.

    Args:
        folder: the folder, absolute, or relative to the working directory or one of the ``roots``.
        height: rows that the panoramas are scaled to.
        fractions: approximate shares of the panoramas in ``train``, ``val`` and ``test``; scenes are not divided.
        seed: seed of the split.
        groups: regular expression searched for in the path below the folder; its first group, or the whole match, is
            the scene. Each file without a match is a scene.
        together: prefixes, up to ``__``, that are one scene each, such as many pictures of one house.
        roots: further folders to search; decoded panoramas are kept in the last.

    Raises:
        UserError: an argument is invalid.
    """

    name = "panorama_folder"

    def __init__(
        self,
        folder: str,
        height: int = 512,
        fractions: Mapping[Split, float] | None = None,
        seed: int = 0,
        groups: str | None = None,
        together: Sequence[str] = ("amsterdam", "zind"),
        roots: Sequence[Path | str] = (),
    ):
        self.looked = [Path(folder).expanduser().absolute(), *(Path(root) / folder for root in roots)]
        self.cache = Path(roots[-1]) if roots else None
        self.height, self.seed, self.together = height, seed, tuple(together)
        self.fractions: dict[Split, float] = dict(fractions or {"train": 0.7, "val": 0.1, "test": 0.2})
        if set(self.fractions) != set(SPLITS) or min(self.fractions.values()) < 0 or not sum(self.fractions.values()):
            raise ArgumentError(
                f"fractions={self.fractions} must give a share, 0 or more, of each of {', '.join(SPLITS)}",
                "For example fractions: {train: 0.7, val: 0.1, test: 0.2}",
            )
        if height < SMALLEST_HEIGHT:
            raise ArgumentError(f"height={height} must be at least {SMALLEST_HEIGHT}", "height=512")
        try:
            self._pattern = None if groups is None else re.compile(groups)
        except re.error as error:
            raise ArgumentError(
                f"groups={groups!r} is not a regular expression: {error}", "For example groups: '^([^_]+)_'"
            ) from None

    @cached_property
    def folder(self) -> Path:
        """The first of the searched paths that is a folder."""
        return first_folder(
            self.looked,
            "folder",
            "Give a folder of panoramas twice as wide as high: folder=/path/to/panoramas. "
            "Without panoramas of your own: dataset=town_panoramas",
        )

    def scene(self, path: Path) -> str:
        """The scene that a file shows, by its name."""
        name = path.relative_to(self.folder).as_posix()
        if self._pattern is not None:
            found = self._pattern.search(name)
            return name if found is None else next((group for group in found.groups() if group), found[0])
        prefix, separator, _ = path.name.partition("__")
        return prefix if separator and prefix in self.together else name

    @cached_property
    def _files(self) -> dict[Split, list[Path]]:
        paths = sorted(image_paths(self.folder))
        scenes: dict[str, list[Path]] = {}
        for path in paths:
            scenes.setdefault(self.scene(path), []).append(path)
        wanted = [split for split in SPLITS if self.fractions[split] > 0]
        if len(scenes) < len(wanted):
            raise MissingDataError(
                f"folder={self.folder}: {counted(len(paths), 'image')} of {len(scenes)} scenes, too few for the "
                f"splits {', '.join(wanted)}",
                f"Add panoramas ({', '.join(SUFFIXES[:3])}, ...), or check `groups` and `together`.",
            )
        side = split_scenes({scene: len(files) for scene, files in scenes.items()}, self.fractions, self.seed)
        return {split: [path for path in paths if side[self.scene(path)] == split] for split in SPLITS}

    def files(self, split: Split) -> list[Path]:
        """The images of a split, sorted; nothing is decoded.

        Raises:
            MissingDataError: there is no such folder, or it has fewer scenes than there are splits.
        """
        return self._files[split]

    def fingerprint(self) -> str:
        """Hash of the names and contents of all files and of how they are split."""
        entries = [[split, self._digest(split)] for split in SPLITS]
        return hashlib.sha256(json.dumps(entries).encode()).hexdigest()

    def read(self, split: Split) -> Panoramas:
        """The panoramas of a split, decoded the first time and memory-mapped from the cache afterwards.

        Raises:
            UserError: files are not panoramas; the message names the first :data:`NAMED` of them.
        """
        paths = self.files(split)
        if not paths:
            raise ArgumentError(f"folder={self.folder}: no {split} panoramas", f"fractions.{split}=0.2")
        names = [path.relative_to(self.folder).as_posix() for path in paths]
        shape = (len(paths), self.height, 2 * self.height, 3)
        if self.cache is None:
            return Panoramas(self._decoded(paths, split), names)
        folder = self.cache / f"{self.name}-{self._digest(split)[:16]}"
        kept = folder / f"{split}.npy"
        images = open_kept(kept, shape, np.uint8)
        if images is None:
            decoded = self._decoded(paths, split)
            with reporting_disk_errors(folder, lambda: decoded.nbytes):
                keep_array(kept, lambda file: np.lib.format.write_array(file, decoded, allow_pickle=False))
            images = open_kept(kept, shape, np.uint8)
            assert images is not None
        return Panoramas(images, names)

    def _digest(self, split: Split) -> str:
        files = [[path.relative_to(self.folder).as_posix(), file_sha256(path)] for path in self.files(split)]
        deep = [LEVELS] if any(map(is_deep, self.files(split))) else []  # 8-bit files do not depend on LEVELS
        return hashlib.sha256(json.dumps([DECODER, self.height, files, *deep]).encode()).hexdigest()

    def _decoded(self, paths: Sequence[Path], split: Split) -> UInt8[ndarray, "n h w 3"]:
        images = np.empty((len(paths), self.height, 2 * self.height, 3), np.uint8)
        notify = notify_every(5.0, f"decoding {split} panoramas of {self.folder}")
        bad: list[str] = []
        levels = WhiteLevels((path for each in SPLITS for path in self.files(each)), f"folder={self.folder}")

        def decode(i: int) -> None:
            try:
                images[i] = decode_panorama(paths[i], self.height, levels)
            except UnfitImageError as error:
                bad.append(f"  {paths[i].relative_to(self.folder)} {error}")

        with ThreadPoolExecutor(os.cpu_count()) as pool:  # Pillow releases the interpreter lock while decoding
            for done, _ in enumerate(pool.map(decode, range(len(paths))), start=1):
                notify(done, len(paths))
        if bad:
            more = f"\n  and {len(bad) - NAMED} more" if len(bad) > NAMED else ""
            listed = "\n".join(sorted(bad)[:NAMED])
            raise ArgumentError(
                f"folder={self.folder}: {len(bad)} of {len(paths)} {split} files are not panoramas\n{listed}{more}",
                "Replace them, or remove them from the folder.",
            )
        return images


def split_scenes(sizes: Mapping[str, int], fractions: Mapping[Split, float], seed: int) -> dict[str, Split]:
    """Assign each scene to a split: large scenes first, each to the split farthest below its share, none left empty.

    ``seed`` determines the order of scenes of the same size.
    """
    total, share = sum(sizes.values()), sum(fractions.values())
    wanted = {split: total * fractions[split] / share for split in SPLITS if fractions[split] > 0}
    order = {scene: hashlib.sha256(f"{seed}:{scene}".encode()).hexdigest() for scene in sizes}
    side: dict[str, Split] = {}
    lacking = dict(wanted)
    empty = set(wanted)
    for left, scene in zip(
        range(len(sizes), 0, -1), sorted(sizes, key=lambda scene: (-sizes[scene], order[scene])), strict=True
    ):
        candidates = empty if left <= len(empty) else set(wanted)
        side[scene] = max(candidates, key=lambda split: (lacking[split], split))
        lacking[side[scene]] -= sizes[scene]
        empty.discard(side[scene])
    return side
