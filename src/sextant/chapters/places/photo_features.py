"""Local features of photos: of which kind, kept in memory, and saved beside the descriptors of a map."""

from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from sextant.applications.pixels import AnyImage, as_pixels
from sextant.array_folder import FolderFormat, file_sha256
from sextant.atomic_files import write_atomically
from sextant.chapters.places.describing import upright_size
from sextant.errors import ArgumentError

if TYPE_CHECKING:
    from sextant.correspondence import LocalFeatureExtractor, LocalFeatures

KIND = FolderFormat("a set of local features", "sextant.local_features", 1, "local_features.json")
FOLDER = "local_features"
ARRAYS = ("points", "descriptors")
#: photos whose features are kept in memory: some 1 GiB at 2,048 keypoints, of 64 half-precision numbers each
KEPT = 4096


def extractor_of(local: "LocalFeatureExtractor | str", describer: object) -> "LocalFeatureExtractor":
    """The local features of a name, or those given.

    Args:
        local: ``xfeat``; ``trunk``, the activations of the network that describes the images; ``aliked:<folder>``, with
            the folder of its weights; or an object that extracts features.
        describer: what describes whole images.

    Raises:
        ArgumentError: there are no such features, or whole images are not described by a network of convolutions.
    """
    from sextant.correspondence import AlikedFeatures, XFeatures

    if not isinstance(local, str):
        return local
    name, _, folder = local.partition(":")
    if local == "xfeat":
        return XFeatures()
    if local == "trunk":
        return trunk_features(describer)
    if name == "aliked" and folder:
        return AlikedFeatures(folder)
    raise ArgumentError(
        f"local={local!r} must be xfeat, trunk, or aliked:<folder of its weights>", "For example local=xfeat"
    )


def trunk_features(describer: object, **settings: Any) -> "LocalFeatureExtractor":
    """The activations of the network that describes whole images, as local features.

    Raises:
        ArgumentError: whole images are not described by a network of convolutions.
    """
    from torch import nn

    from sextant.baselines.network_layer import NetworkLayer
    from sextant.correspondence import TrunkFeatures
    from sextant.correspondence.trunk_features import rgb
    from sextant.models import PlaceNet

    network = getattr(describer, "network", describer)
    if isinstance(network, PlaceNet):
        trunk: nn.Module = nn.Sequential(network.standardize, network.backbone)
        channels = len(network.standardize.mean.flatten())
    elif isinstance(describer, NetworkLayer):
        trunk, channels = describer.features, describer.channels
    else:
        raise ArgumentError(
            f"local=trunk: {type(describer).__name__} is not a network, so it has no activations", "local=xfeat"
        )
    return TrunkFeatures(rgb(trunk, channels).eval(), identity=getattr(describer, "model", ""), **settings)


class PhotoFeatures:
    """Local features of photos; those of files are computed once, and the most recently used kept in memory.

    Args:
        extractor: detects them. Larger photos are decoded at its ``side``.
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
        if isinstance(photo, Path | str) and Path(photo).is_file():
            width, height = upright_size(Path(photo))
            scale = min(1.0, self.side / max(width, height))
            size = (max(1, round(scale * height)), max(1, round(scale * width)), 3)
        pixels = as_pixels(photo, size)
        return np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels


def save_features(features: PhotoFeatures, names: Mapping[Path, str], folder: Path) -> None:
    """Write the features that are kept, of the photos of a map; the header last.

    Args:
        features: some of them may be saved in this folder already.
        names: names of the map's photos by file.
        folder: the map's folder.

    Raises:
        OSError: the folder cannot be written to.
    """
    kept = {names[file]: found for file, found in features.kept.items() if file in names}
    if not kept:
        return
    (folder / FOLDER).mkdir(exist_ok=True)
    (folder / FOLDER / KIND.header).unlink(missing_ok=True)
    hashes = {}
    for name in ARRAYS:
        array = np.concatenate([getattr(each, name) for each in kept.values()])
        path = folder / FOLDER / f"{name}.npy"
        write_atomically(path, lambda file, array=array: np.save(file, array, allow_pickle=False))  # type: ignore[misc]
        hashes[name] = file_sha256(path)
    KIND.write_header(
        folder / FOLDER,
        {
            "model": features.extractor.model,
            "sha256": hashes,
            "photos": [
                {"name": name, "keypoints": len(each), "width": each.width, "height": each.height, "pixel": each.pixel}
                for name, each in kept.items()
            ],
        },
    )


def saved_features(folder: Path, model: str, files: Mapping[str, Path]) -> "dict[Path, LocalFeatures]":
    """The features saved beside a map, memory-mapped; none where there are none, or of another kind.

    Args:
        folder: the map's folder.
        model: that of the extractor.
        files: files of the map's photos by name.

    Raises:
        UserError: they are damaged.
    """
    from sextant.correspondence import LocalFeatures

    folder = folder / FOLDER
    if not (folder / KIND.header).is_file():
        return {}
    header = KIND.read_header(folder)
    if header["model"] != model:
        return {}
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
    return found
