"""The descriptor of a map, saved beside it, so that images can be described wherever the folder is moved.

``descriptor.json`` names a class of :mod:`sextant.baselines` with its arguments, or holds the config of a trained
network; ``descriptor.safetensors`` holds its fitted arrays. Nothing is pickled, and the header has the hash of
the arrays.
"""

import copy
import hashlib
import inspect
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from jaxtyping import Float32, Float64, UInt8
from numpy import ndarray
from torch import Tensor

from sextant.array_folder import plain_values
from sextant.atomic_files import file_sha256, read_json, write_atomically, write_json
from sextant.baselines import Hog, PatchNormalised, Pixels, PlaceDescriptor, WhitenedPCA
from sextant.baselines.network_layer import NetworkLayer
from sextant.chapters.places.given_descriptors import GivenDescriptors
from sextant.errors import ArgumentError, UserError

HEADER, ARRAYS = "descriptor.json", "descriptor.safetensors"
FORMAT, VERSION = "sextant.map_descriptor", 1
BASELINES: dict[str, type[PlaceDescriptor]] = {c.__name__: c for c in (Hog, PatchNormalised, Pixels, WhitenedPCA)}
WEIGHTS = "network/"  # prefix of the weights of a network of kind layer
WHITENER = "whitener of the map"  # the name of a module cannot contain spaces
COMPONENTS = ("components_", "mean_", "explained_variance_")


class Describes(Protocol):
    """Anything that computes descriptors of images."""

    def describe(self, images: UInt8[ndarray, "b h w c"]) -> Float32[ndarray, "b d"]:
        """The descriptors of a few images."""


@dataclass(frozen=True, eq=False)
class SavedDescriptor:
    """A descriptor with all that is needed to recreate it.

    Attributes:
        describer: the descriptor; None if vectors come from elsewhere.
        facts: how it is recreated, as plain values; ``kind`` is baseline, network (of a run), layer (of a network that
            no run trained), given (vectors from elsewhere), or none if it cannot be.
        arrays: its fitted arrays.
        whitener: matrix by which vectors are multiplied before they are compared; None for none.
    """

    describer: Describes | None = None
    facts: dict[str, Any] = field(default_factory=lambda: {"kind": "none"})
    arrays: dict[str, Tensor] = field(default_factory=dict)
    whitener: Float64[Tensor, "d d"] | None = None

    @property
    def identity(self) -> str:
        """A hash that changes whenever the descriptors would change."""
        return _identity(self.facts, self._packed())

    @property
    def model(self) -> str:
        """Identifies descriptors with comparable vectors; for a network, the hash of its checkpoint."""
        own = self.facts.get("checkpoint_sha256") or getattr(self.describer, "model", None)
        return str(own or (type(self.describer).__qualname__ if self.facts["kind"] == "none" else self.identity))

    def _packed(self) -> bytes:
        from safetensors.torch import save

        arrays = dict(self.arrays) if self.whitener is None else {**self.arrays, WHITENER: self.whitener}
        # clones, because safetensors refuses views of one storage, which networks have
        return save({name: tensor.detach().cpu().clone().contiguous() for name, tensor in sorted(arrays.items())})

    def save(self, folder: Path) -> None:
        """Write both files; the header last.

        Raises:
            ArgumentError: JSON cannot hold one of the facts; then a descriptor that was there is kept.
            OSError: the folder cannot be written to.
        """
        packed, facts = self._packed(), plain_values(self.facts)
        (folder / HEADER).unlink(missing_ok=True)
        write_atomically(folder / ARRAYS, lambda file: file.write(packed))
        marks = {"sha256": hashlib.sha256(packed).hexdigest(), "identity": _identity(facts, packed)}
        write_json(folder / HEADER, {"format": FORMAT, "version": VERSION, **marks, "facts": facts})


def kept_baseline(descriptor: Describes) -> SavedDescriptor:
    """A training-free descriptor, fitted to the map; or a user-defined one, which cannot be saved."""
    if isinstance(descriptor, GivenDescriptors):
        return SavedDescriptor(descriptor, plain_values({"kind": "given", "dimension": descriptor.dimension}))
    name = type(descriptor).__name__
    if BASELINES.get(name) is not type(descriptor):
        return SavedDescriptor(descriptor)
    arguments = plain_values({key: getattr(descriptor, key) for key in inspect.signature(type(descriptor)).parameters})
    arrays: dict[str, Tensor] = {}
    if isinstance(descriptor, WhitenedPCA):
        arrays = {key: torch.from_numpy(np.array(getattr(descriptor.pca_, key), order="C")) for key in COMPONENTS}
        descriptor = copy.copy(descriptor)  # in the same memory layout as when loaded, so that sums are rounded alike
        descriptor.pca_ = _pca(arrays)
    return SavedDescriptor(descriptor, {"kind": "baseline", "class": name, "arguments": arguments}, arrays)


def kept_layer(layer: NetworkLayer, nodes: Mapping[str, Any]) -> SavedDescriptor:
    """A network that no run trained, fitted to the map, with the parts that it was built from."""
    arrays = {f"{WEIGHTS}{name}": value for name, value in layer.features.state_dict().items()}
    if layer.dimensions is not None:
        arrays |= {key: torch.from_numpy(np.array(getattr(layer.pca_, key), order="C")) for key in COMPONENTS}
        layer = copy.copy(layer)  # as above
        layer.pca_ = _pca(arrays)
    return SavedDescriptor(layer, {"kind": "layer", "nodes": dict(nodes)}, arrays)


def baseline_names() -> str:
    """The names that a user can give, separated by commas."""
    return ", ".join(sorted(BASELINES))


def find_baseline(name: str) -> type[PlaceDescriptor] | None:
    """The training-free descriptor of that name, in any spelling: ``Hog``, ``whitened_pca``, ``patch-normalised``."""
    plain = re.sub(r"[^a-z]", "", name.lower())
    return next((kind for known, kind in BASELINES.items() if known.lower() == plain), None)


def named_baseline(name: str) -> PlaceDescriptor:
    """The training-free descriptor of a given name, with its defaults.

    Raises:
        ArgumentError: there is no descriptor of that name.
    """
    kind = find_baseline(name)
    if kind is None:
        raise ArgumentError(f"descriptor={name!r} must be one of {baseline_names()}", 'For example descriptor="Hog"')
    return kind()


def kept_network(checkpoint: Path, content: Mapping[str, Any] | None = None, *, trust: bool = False) -> SavedDescriptor:
    """The network of a place-recognition run.

    Args:
        checkpoint: file of the checkpoint.
        content: content of the file, if it was read already.
        trust: build user-defined parts that the checkpoint names.

    Raises:
        UserError: the checkpoint cannot be read or is of another task, or needs user-defined code.
    """
    from sextant.kit.published_places import CARD
    from sextant.kit.trained import read_trained
    from sextant.runs.checkpoint import KEY

    content = read_trained(checkpoint) if content is None else content
    trained = {key: content[KEY][key] for key in ("config", "spec", "task", CARD) if key in content[KEY]}
    sha256 = file_sha256(checkpoint)
    return _network(
        {"kind": "network", "checkpoint_sha256": sha256, **trained}, content["state_dict"], checkpoint, trust
    )


def load_descriptor(folder: Path, *, trust: bool = False) -> SavedDescriptor:
    """Load what :meth:`SavedDescriptor.save` wrote.

    Raises:
        UserError: a file is missing or damaged, or the network needs user-defined code and ``trust`` is false.
    """
    from safetensors import SafetensorError
    from safetensors.torch import load

    header = read_json(folder / HEADER)
    if not isinstance(header, dict) or header.get("format") != FORMAT or header.get("version") != VERSION:
        raise _damaged(folder, f"{HEADER} is missing, or is not the header of a descriptor")
    try:
        packed, facts = (folder / ARRAYS).read_bytes(), header["facts"]
        if hashlib.sha256(packed).hexdigest() != header["sha256"]:  # before any of its content is interpreted
            raise _damaged(folder, f"{ARRAYS} is not the file that {HEADER} was written for")
        if _identity(facts, packed) != header["identity"]:
            raise _damaged(folder, f"{HEADER} was changed")
        arrays = load(packed)
        whitener = arrays.pop(WHITENER, None)
        if facts["kind"] == "none":
            return SavedDescriptor(None, facts, arrays, whitener)
        if facts["kind"] == "given":
            return SavedDescriptor(GivenDescriptors(int(facts["dimension"])), facts, arrays, whitener)
        if facts["kind"] == "network":
            return replace(_network(facts, arrays, folder / ARRAYS, trust), whitener=whitener)
        if facts["kind"] == "layer":
            return SavedDescriptor(_layer(facts["nodes"], arrays, trust), facts, arrays, whitener)
        descriptor = BASELINES[facts["class"]](**facts["arguments"])
        if isinstance(descriptor, WhitenedPCA):
            descriptor.pca_ = _pca(arrays)
        return SavedDescriptor(descriptor, facts, arrays, whitener)
    except (OSError, KeyError, TypeError, ValueError, SafetensorError) as error:
        raise _damaged(folder, f"{HEADER} and {ARRAYS} do not form a descriptor: {error}") from error


def _network(facts: dict[str, Any], weights: Mapping[str, Tensor], file: Path, trust: bool) -> SavedDescriptor:
    from sextant.chapters.places.network import trained_place_network
    from sextant.runs.checkpoint import KEY

    content = {KEY: facts, "state_dict": weights}
    network = trained_place_network(content, file, facts["checkpoint_sha256"], trust=trust)
    return SavedDescriptor(network, facts, dict(weights))


def _layer(nodes: Mapping[str, Any], arrays: Mapping[str, Tensor], trust: bool) -> NetworkLayer:
    from sextant.chapters.places.backbone_layer import layer_of_file

    weights = {name.removeprefix(WEIGHTS): value for name, value in arrays.items() if name.startswith(WEIGHTS)}
    layer = layer_of_file(nodes, weights, trust=trust)
    if layer.dimensions is not None:
        layer.pca_ = _pca(arrays)
    return layer


def _pca(arrays: Mapping[str, Tensor]) -> Any:
    from sklearn.decomposition import PCA

    dimensions = len(arrays["components_"])
    pca = PCA(dimensions, whiten=True)
    for name in COMPONENTS:
        setattr(pca, name, arrays[name].numpy().copy())
    pca.n_components_ = dimensions
    return pca


def _identity(facts: Mapping[str, Any], packed: bytes) -> str:
    told = json.dumps(json.loads(json.dumps(facts, default=str)), sort_keys=True).encode()  # as read back from a file
    return hashlib.sha256(told + b"\0" + hashlib.sha256(packed).digest()).hexdigest()


def _damaged(folder: Path, how: str) -> UserError:
    return UserError(f"the descriptor in {folder} is damaged: {how}", "Save the map again, or copy it again.")
