"""Local features of photos: of which kind, kept in memory, and saved beside the descriptors of a map."""

import hashlib
import re
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from sextant.applications.pixels import AnyImage, as_pixels
from sextant.array_folder import FolderFormat, plain_values
from sextant.atomic_files import hash_file, write_atomically
from sextant.chapters.places.describing import upright_size
from sextant.errors import ArgumentError, UserError, shown

if TYPE_CHECKING:
    from sextant.correspondence import LocalFeatureExtractor, LocalFeatures, TrunkFeatures

KIND = FolderFormat("a set of local features", "sextant.local_features", 1, "local_features.json")
FOLDER = "local_features"
ARRAYS = ("points", "descriptors")
#: photos whose features are kept in memory: some 1 GiB at 2,048 keypoints, of 64 half-precision numbers each
KEPT = 4096


def extractor_of(local: "LocalFeatureExtractor | str", describer: object, **settings: Any) -> "LocalFeatureExtractor":
    """The local features of a name, or those given.

    Args:
        local: ``xfeat``; ``trunk``, the activations of the network that describes the images; ``aliked:<folder>``, with
            the folder of its weights; or an object that extracts features.
        describer: what describes whole images.
        settings: of the features that are named, such as ``keypoints`` and ``side``.

    Raises:
        ArgumentError: there are no such features, whole images are not described by a network of convolutions, or
            weights or packages are missing.
    """
    from sextant.correspondence import AlikedFeatures, XFeatures

    if not isinstance(local, str):
        return checked(local)
    name, _, folder = local.partition(":")
    if local == "xfeat":
        return checked(XFeatures(**settings))
    if local == "trunk":
        return checked(trunk_features(describer, **settings))
    if name == "aliked" and folder:
        return checked(AlikedFeatures(folder, **settings))
    raise ArgumentError(
        f"local={local!r} must be xfeat, trunk, or aliked:<folder of its weights>", "For example local=xfeat"
    )


def checked(extractor: Any) -> "LocalFeatureExtractor":
    """The same local features, after their own ``check()``, if they have one.

    Raises:
        ArgumentError: it is no :class:`~sextant.correspondence.LocalFeatureExtractor`.
    """
    missing = [name for name in ("name", "model", "side", "detect", "match") if not hasattr(extractor, name)]
    if missing:
        raise ArgumentError(
            f"local={shown(extractor)} extracts no local features: it has no {', '.join(missing)}",
            "Give xfeat, trunk, aliked:<folder of its weights>, or a LocalFeatureExtractor.",
        )
    check = getattr(extractor, "check", None)
    if check is not None:
        check()
    found: LocalFeatureExtractor = extractor
    return found


def trunk_features(describer: object, **settings: Any) -> "TrunkFeatures":
    """The activations of the network that describes whole images, as local features.

    Raises:
        ArgumentError: whole images are not described by a network of convolutions.
    """
    from torch import nn

    from sextant.baselines.network_layer import NetworkLayer
    from sextant.correspondence import TrunkFeatures
    from sextant.correspondence.trunk_features import trunk_of
    from sextant.models import PlaceNet

    network = getattr(describer, "network", describer)
    if isinstance(network, PlaceNet):
        parts = {"standardize": network.standardize, "backbone": network.backbone}
        channels = len(network.standardize.mean.flatten())
    elif isinstance(describer, NetworkLayer):
        parts, channels = {"backbone": describer.features}, describer.channels
    else:
        kind = type(network).__name__
        told = (
            f"the activations of {kind} are not read, only those of networks that are trained here"
            if isinstance(network, nn.Module)
            else f"{kind} is not a network, so it has no activations"
        )
        raise ArgumentError(f"local=trunk: {told}", "local=xfeat")
    return TrunkFeatures(trunk_of(parts, channels), identity=getattr(describer, "model", ""), **settings)


class PhotoFeatures:
    """Local features of photos; those of files are computed once, and the most recently used kept in memory.

    Args:
        extractor: detects them. Larger photos are decoded at its ``side``, if it has one.
        saved: features of files that were saved, by file.
    """

    def __init__(self, extractor: "LocalFeatureExtractor", saved: "Mapping[Path, LocalFeatures] | None" = None):
        self.extractor = extractor
        self._saved = saved or {}
        self._computed: OrderedDict[Path, LocalFeatures] = OrderedDict()

    @property
    def side(self) -> int:
        """The longer side of images, in whose pixels distances from epipolar lines are measured."""
        return self.extractor.side or 640

    @property
    def kept(self) -> "dict[Path, LocalFeatures]":
        """All features of files that are saved or in memory."""
        return {**self._saved, **self._computed}

    @property
    def bytes_per_photo(self) -> int:
        """Mean size of the features of a file."""
        kept = self.kept.values()
        return round(sum(each.nbytes for each in kept) / max(1, len(kept)))

    def has(self, file: Path) -> bool:
        """Whether the features of a file are saved or in memory."""
        return file in self._computed or file in self._saved

    def of_file(self, file: Path) -> "LocalFeatures":
        """The features of a file of the map; raises as :meth:`of`."""
        if file in self._saved:
            return self._saved[file]
        if file not in self._computed:
            self._computed[file] = self.of(file)
            if len(self._computed) > KEPT:
                self._computed.popitem(last=False)
        self._computed.move_to_end(file)
        return self._computed[file]

    def of(self, photo: AnyImage) -> "LocalFeatures":
        """The features of a file, bytes or a Pillow image.

        Raises:
            UserError: it cannot be read, or the features need a package that is not installed.
        """
        (found,) = self.extractor.detect([self._pixels(photo)])
        return found

    def _pixels(self, photo: AnyImage) -> UInt8[ndarray, "h w 3"]:
        size = None
        side = self.extractor.side
        if side is not None and isinstance(photo, Path | str) and Path(photo).is_file():
            width, height = upright_size(Path(photo))
            scale = min(1.0, side / max(width, height))
            size = (max(1, round(scale * height)), max(1, round(scale * width)), 3)
        pixels = as_pixels(photo, size)
        return np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels


@dataclass(frozen=True)
class Kind:
    """Local features of one kind.

    Attributes:
        name, model: those of the extractor.
        features: by file.
    """

    name: str
    model: str
    features: "Mapping[Path, LocalFeatures]"


def save_features(kinds: Iterable[Kind], names: Mapping[Path, str], folder: Path, index: str) -> None:
    """Write local features of the photos of a map, one folder per kind; those of another map are removed.

    Args:
        kinds: what is kept, the latest last; features of equal ``model`` are put together. Some may be saved in this
            folder already.
        names: names of the map's photos by file.
        folder: the map's folder.
        index: hash of the map's index, by which its features are known again.

    Raises:
        OSError: the folder cannot be written to.
    """
    files = {name: file for file, name in names.items()}
    there = {kind.model: kind for kind in stored_kinds(folder, files, index)}
    merged: dict[str, Kind] = dict(there)
    for kind in kinds:
        kept = {file: found for file, found in kind.features.items() if file in names}
        before = merged[kind.model].features if kind.model in merged else {}
        if kept:
            merged[kind.model] = Kind(kind.name, kind.model, {**before, **kept})
    written = {_folder_of(kind.name, kind.model) for kind in merged.values()}
    if (folder / FOLDER).is_dir():
        for each in (*(folder / FOLDER).iterdir(), folder / FOLDER):
            if each.name not in written:
                _remove(each)
    for kind in merged.values():
        if kind.model not in there or kind.features.keys() != there[kind.model].features.keys():
            _write(kind, names, folder / FOLDER / _folder_of(kind.name, kind.model), index)


def _folder_of(name: str, model: str) -> str:
    return f"{re.sub(r'[^a-z0-9]+', '_', name.lower())}-{hashlib.sha256(model.encode()).hexdigest()[:12]}"


def _remove(folder: Path) -> None:
    """Remove the files of local features in a folder, and the folder if it is empty then."""
    for name in (KIND.header, *(f"{name}.npy" for name in ARRAYS)):
        if folder.is_dir():
            (folder / name).unlink(missing_ok=True)
    with suppress(OSError):
        folder.rmdir()


def header_of(kind: Kind, names: Mapping[Path, str], index: str = "") -> dict[str, Any]:
    """What the header says of the features of a map's photos, without the hashes of its arrays.

    Raises:
        ArgumentError: a value of the extractor cannot be saved.
    """
    return plain_values(
        {
            "name": kind.name,
            "model": kind.model,
            "index_sha256": index,
            "sha256": {},
            "photos": [
                {
                    "name": names[file],
                    "keypoints": len(each),
                    "width": each.width,
                    "height": each.height,
                    "pixel": each.pixel,
                }
                for file, each in kind.features.items()
                if file in names
            ],
        }
    )


def _write(kind: Kind, names: Mapping[Path, str], folder: Path, index: str) -> None:
    """Write the features of one kind; the header last."""
    facts = header_of(kind, names, index)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / KIND.header).unlink(missing_ok=True)
    for name in ARRAYS:
        array = np.concatenate([getattr(each, name) for each in kind.features.values()])
        path = folder / f"{name}.npy"
        write_atomically(path, lambda file, array=array: np.save(file, array, allow_pickle=False))  # type: ignore[misc]
        facts["sha256"][name] = hash_file(path)
    KIND.write_header(folder, facts)


def saved_features(folder: Path, extractor: Any, files: Mapping[str, Path], index: str) -> "dict[Path, LocalFeatures]":
    """The features saved beside a map, memory-mapped; none where there are none of this kind, or of another map.

    Args:
        folder: the map's folder.
        extractor: of the same kind.
        files: files of the map's photos by name.
        index: hash of the map's index.

    Raises:
        UserError: they are damaged.
    """
    found = _read(folder / FOLDER / _folder_of(extractor.name, extractor.model), files, index)
    return {} if found is None else dict(found.features)


def stored_kinds(folder: Path, files: Mapping[str, Path], index: str) -> list[Kind]:
    """All local features saved beside a map, except damaged ones; arguments as for :func:`saved_features`."""
    kinds = []
    for each in sorted((folder / FOLDER).iterdir()) if (folder / FOLDER).is_dir() else ():
        with suppress(UserError):
            found = _read(each, files, index)
            if found is not None:
                kinds.append(found)
    return kinds


def _read(folder: Path, files: Mapping[str, Path], index: str) -> Kind | None:
    if not (folder / KIND.header).is_file():
        return None
    header = KIND.read_header(folder)
    if header.get("index_sha256") != index:
        return None
    try:
        return _features(folder, header, files)
    except (ArgumentError, LookupError, TypeError, ValueError) as error:
        why = error.problem if isinstance(error, ArgumentError) else repr(error)
        raise KIND.damaged(folder, f"{KIND.header} or its arrays cannot be used: {why}") from error


def _features(folder: Path, header: Mapping[str, Any], files: Mapping[str, Path]) -> Kind:
    from sextant.correspondence import LocalFeatures

    points, descriptors = (
        KIND.open_array(folder, folder / f"{name}.npy", "r", sha256=header["sha256"][name]) for name in ARRAYS
    )
    ends = np.cumsum([photo["keypoints"] for photo in header["photos"]])
    if len(points) != len(descriptors) or (len(ends) and ends[-1] != len(points)):
        raise KIND.damaged(folder, "its arrays and its header differ in number")
    found = {}
    for photo, end in zip(header["photos"], ends.tolist(), strict=True):
        rows = slice(end - photo["keypoints"], end)
        each = LocalFeatures(points[rows], descriptors[rows], photo["width"], photo["height"], photo["pixel"])
        if photo["name"] in files:
            found[files[photo["name"]]] = each
    return Kind(header["name"], header["model"], found)
