"""Image descriptors for localization: training-free, from a trained network, or computed elsewhere.

Checks made before a run starts import nothing heavy.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from sextant.atomic_files import file_sha256
from sextant.chapters.places.config import Average, DescribingConfig, Flatten, GeM, NetworkDescriptor
from sextant.chapters.places.given_descriptors import checked_rows, open_rows
from sextant.config.building import build, part_name
from sextant.config.schema.parts import CustomPart
from sextant.config.trained import STARTS_FROM
from sextant.data.photo_files import walk_folder
from sextant.data.picture_files import open_picture, why_unreadable
from sextant.data.upright import upright_size
from sextant.errors import UserError
from sextant.moved import with_first_names
from sextant.runs.resolve import resolve_run

if TYPE_CHECKING:
    from sextant.baselines.place_descriptors import PlaceDescriptor
    from sextant.chapters.places.data.image_rows import ImageRows
    from sextant.chapters.places.network import TrainedPlaceNetwork

#: images of a map that a training-free descriptor is shown to learn from, unless it asks for more
MOST_IMAGES = 10_000


@runtime_checkable
class Describer(Protocol):
    """Computes the descriptors of images.

    Attributes:
        identity: changes whenever the descriptors would.
    """

    identity: str

    def fit(self, images: "ImageRows") -> None:
        """Learn from the images of a map; most describers learn nothing."""

    def describe(self, images: UInt8[ndarray, "b h w c"]) -> Float32[ndarray, "b d"]:
        """Descriptors of a few images."""


@dataclass(frozen=True)
class TrainedDescriptor:
    """The network of a run of place recognition.

    Args:
        run: an MLflow run id, a run directory or its name, or a checkpoint.
    """

    run: str

    def identity(self, outputs: Path) -> str:
        """The hash of its checkpoint.

        Raises:
            UserError: the run does not exist.
        """
        return resolve_run(self.run, outputs, "descriptor.run").identity

    def describer(self, outputs: Path) -> "NetworkDescriber":
        """The network, ready to describe images of the size it was trained on.

        Raises:
            UserError: the run does not exist, it is not a run of place recognition, or it is a file from elsewhere that
                names parts from outside Sextant.
        """
        from sextant.chapters.places.network import trained_place_network
        from sextant.kit.trained import read_trained
        from sextant.runs.checkpoint import KEY

        found = resolve_run(self.run, outputs, "descriptor.run")
        content = read_trained(found.checkpoint)
        if (trained := content[KEY])["task"] != "place_recognition":
            raise UserError(
                f"descriptor.run={self.run} is a run of task={trained['task']}, which has no place descriptor",
                "Name a run of task=place_recognition.",
            )
        network = trained_place_network(content, found.checkpoint, found.identity, trust=found.is_own(outputs))
        return NetworkDescriber(network)


@dataclass(frozen=True)
class DescriptorFiles:
    """Vectors that were computed elsewhere: ``<folder>/<drive>.npy``, one row per image.

    Args:
        folder: folder of the files.
    """

    folder: str

    def identity(self) -> str:
        """The hash of the names and contents of all files.

        Raises:
            UserError: the folder does not exist, has no such file, or its files have different widths.
        """
        root = Path(self.folder).expanduser()
        paths = sorted(root / path for path in walk_folder(root).files if path.suffix == ".npy")
        if not paths:
            raise UserError(
                f"descriptor.folder={self.folder}: there is no such folder, or no .npy file in it",
                "One file per drive: <drive>.npy, an array (images, dimensions) of 32-bit floats.",
            )
        widths = {path.relative_to(root).as_posix(): open_rows(path, "descriptor.folder").shape[-1] for path in paths}
        first = next(iter(widths))
        if other := [name for name, width in widths.items() if width != widths[first]]:
            raise UserError(
                f"descriptor.folder={self.folder}: {first} has {widths[first]} numbers per image, {other[0]} has "
                f"{widths[other[0]]}; map and drives must be described by the same descriptor",
                f"Describe the images of {first.removesuffix('.npy')} or {other[0].removesuffix('.npy')} again.",
            )
        hashed = hashlib.sha256()
        for name, path in zip(widths, paths, strict=True):
            hashed.update(name.encode() + b"\0" + bytes.fromhex(file_sha256(path)))
        return hashed.hexdigest()

    def of(self, drive: str, count: int) -> Float32[ndarray, "n d"]:
        """The vectors of a drive, by its name, of ``count`` images.

        Raises:
            UserError: the file is missing, is not an array of floats, has the wrong number of rows, or has a
                row that is not finite.
        """
        path = Path(self.folder).expanduser() / f"{drive}.npy"
        fix = "Describe the images of this drive again, in their order."
        return checked_rows(open_rows(path, "descriptor.folder"), str(path), count, fix)


class BaselineDescriber:
    """A training-free descriptor, or one that learns only from the images of the map."""

    def __init__(self, descriptor: "PlaceDescriptor", identity: str):
        self.descriptor, self.identity = descriptor, identity

    def fit(self, images: "ImageRows") -> None:
        """Learn from at most 10,000 images of the map, evenly spaced, or as many as the descriptor asks for."""
        most = max(MOST_IMAGES, getattr(self.descriptor, "most_images", 0))
        rows = np.unique(np.linspace(0, len(images) - 1, min(len(images), most)).astype(np.int64))
        try:
            self.descriptor.fit(images[rows])
        except ValueError as error:
            raise UserError(f"descriptor: {error}", "descriptor.dimensions=<fewer>, or a larger map") from None

    def describe(self, images: UInt8[ndarray, "b h w c"]) -> Float32[ndarray, "b d"]:
        """Descriptors of a few images."""
        return self.descriptor.describe(images)


class LayerDescriber(BaselineDescriber):
    """The network of the groups ``backbone``, ``inhibition`` and ``pooling``, without further training.

    Args:
        nodes: these groups and the descriptor's own, as plain values.
    """

    def __init__(self, nodes: Mapping[str, Any]):
        from sextant.chapters.places.backbone_layer import backbone_layer, layer_identity

        self.nodes, self.layer = nodes, backbone_layer(nodes)
        super().__init__(self.layer, layer_identity(self.layer, nodes))


class NetworkDescriber:
    """A trained place-recognition network as descriptor."""

    def __init__(self, network: "TrainedPlaceNetwork"):
        self.network, self.identity = network, network.model

    def fit(self, images: "ImageRows") -> None:
        """Learn nothing; check that the images have the size on which the network was trained.

        Raises:
            UserError: they do not.
        """
        size = self.network.size
        if images.shape[1:] != (size.height, size.width, size.channels):
            _, height, width, channels = images.shape
            raise UserError(
                f"the images are {height}x{width}x{channels}, but the descriptor was trained on "
                f"{size.height}x{size.width}x{size.channels}",
                f"dataset.height={size.height} dataset.width={size.width}",
            )

    def describe(self, images: UInt8[ndarray, "b h w c"]) -> Float32[ndarray, "b d"]:
        """Descriptors of a few images."""
        return np.concatenate([self.network.describe(images[k : k + 256]) for k in range(0, len(images), 256)])


def descriptor_identity(node: Mapping[str, Any], outputs: Path) -> dict[str, Any]:
    """A descriptor's config with hashes of its files in place of their paths. Imports nothing heavy.

    Raises:
        UserError: the run, folder or photo does not exist.
    """
    if "run" in node:
        return {"_target_": node["_target_"], "run": TrainedDescriptor(node["run"]).identity(outputs)}
    if "folder" in node:
        return {"_target_": node["_target_"], "folder": DescriptorFiles(node["folder"]).identity()}
    if "photo" in node:
        network = node["network"] and TrainedDescriptor(node["network"]).identity(outputs)
        return {**node, "photo": _photo_identity(node["photo"], node["points"]), "network": network}
    return dict(node)


def check_network_parts(config: DescribingConfig) -> None:
    """Check that ``backbone``, ``inhibition`` and ``pooling`` fit the descriptor. Imports nothing heavy.

    Raises:
        UserError: they are given, but the descriptor has no network or one of its own; or it is built from them, and
            there is no backbone or the pooling would have to be trained.
    """
    groups = {name: getattr(config, name, None) for name in ("backbone", "inhibition", "pooling")}
    if not isinstance(config.descriptor, NetworkDescriptor):
        given = next((name for name, part in groups.items() if part is not None), None)
        if given is None or config.descriptor is None:
            return
        kind = part_name({"_target_": config.descriptor.target}).removesuffix("()")
        of = "has a network of its own" if "run" in config.plain["descriptor"] else f"({kind}) has no network"
        raise UserError(
            f"{given}={part_name(config.plain[given])}: the descriptor {of}",
            f"Use descriptor=network with this {given}, or leave out {given}=",
        )
    if config.backbone is None:
        raise UserError("descriptor=network: no backbone is chosen", "backbone=efficientnet_lite0 backbone.stages=5")
    pooling = groups["pooling"]
    if pooling is not None and not isinstance(pooling, Average | GeM | Flatten | CustomPart):
        raise UserError(
            f"pooling={part_name(config.plain['pooling'])} has to be trained, but descriptor=network is not trained",
            "pooling=gem, average or flatten; or descriptor=run:<a run of task=place_recognition with this pooling>",
        )


def about_weights(config: DescribingConfig) -> list[str]:
    """A note for the reader about a network without pretrained weights."""
    brings = any(config.plain["backbone"].get(key) for key in STARTS_FROM) if config.backbone is not None else True
    if brings or not isinstance(config.descriptor, NetworkDescriptor):
        return []
    return [f"descriptor=network: the weights of the backbone are drawn by descriptor.seed={config.descriptor.seed}"]


def _photo_identity(photo: str, points: Sequence[Sequence[float]]) -> str:
    """The hash of a photo; raises a ``UserError`` unless all points lie on it."""
    path = Path(photo).expanduser()
    try:
        with open_picture(path) as image:
            width, height = upright_size(image)
        digest = file_sha256(path)
    except OSError as error:
        raise UserError(f"descriptor.photo={photo} {why_unreadable(path, error)}", "Give a photo's path.") from None
    for x, y in points:
        if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
            raise UserError(
                f"descriptor.points=[[{x:g},{y:g}]] lies outside {path.name}, which has {width}x{height} pixels",
                "Give x and y in pixels of the photo.",
            )
    return digest


def describer(config: DescribingConfig) -> Describer | DescriptorFiles:
    """Build the descriptor that a config names.

    Raises:
        UserError: the descriptor cannot be built.
    """
    if isinstance(config.descriptor, NetworkDescriptor):
        from sextant.chapters.places.backbone_layer import layer_nodes

        return LayerDescriber(layer_nodes(config.plain))
    node = dict(config.plain["descriptor"])
    if "photo" in node and node.get("network"):  # landmarks; in the user's own parts the key may mean anything
        node["network"] = str(resolve_run(node["network"], Path(config.paths.outputs), "descriptor.network").checkpoint)
    found = build({"descriptor": node}, "descriptor")
    if isinstance(found, DescriptorFiles):
        return found
    if isinstance(found, TrainedDescriptor):
        return found.describer(Path(config.paths.outputs))
    identity = with_first_names(descriptor_identity(config.plain["descriptor"], Path(config.paths.outputs)))
    return BaselineDescriber(found, str(sorted(identity.items())))
