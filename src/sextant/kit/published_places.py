"""Networks for places that are not of Sextant, in the form of a checkpoint: so they open wherever a run does."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from sextant.atomic_files import file_sha256
from sextant.errors import UserError
from sextant.kit.published import published_config
from sextant.zoo.files import CARD as ZOO_CARD
from sextant.zoo.files import WEIGHTS

#: key of what is known about a network that is not of Sextant
CARD = "card"


def places_content(path: Path, other: Callable[[Path, Any], dict[str, Any]] | None = None) -> dict[str, Any]:
    """A checkpoint, or a published network for places in the form of one.

    The training settings in the config of the latter are not those of its authors.

    Args:
        path: its file, of ``torch.save`` or safetensors.
        other: is given a file that is neither, with its content, or None if that cannot be read.

    Raises:
        UserError: the file is missing, damaged or neither; nothing in it was executed.
    """
    from sextant.models.published_arrays import tensors_of
    from sextant.models.published_place_file import kind_of, read_published_places
    from sextant.runs.checkpoint import KEY, load_plain, require_checkpoint

    try:
        content = _safetensors(path) if path.suffix == WEIGHTS else load_plain(path)
    except UserError:
        if other is not None:
            return other(path, None)
        raise
    if isinstance(content, dict) and KEY in content:
        return require_checkpoint(content, path)
    tensors = tensors_of(content)
    if tensors is None or kind_of(tensors) is None:
        if other is not None:
            return other(path, content)
        if tensors is None:
            return require_checkpoint(content, path)
    found = read_published_places(tensors, str(path))
    backbone = {"_target_": "sextant.models.published_place_net.PublishedPlaceNet", **found.settings}
    state = {f"network.{name}": tensor for name, tensor in found.state.items()}
    return _content(path, found.title, backbone, state, found.image_size, found.dimension)


def onnx_content(path: Path) -> dict[str, Any]:
    """An ONNX file in the form of a checkpoint; its bytes are the weights.

    Raises:
        UserError: the file is missing, or no network of images to descriptors, or onnxruntime is not installed.
    """
    import numpy as np
    import torch

    from sextant.models.onnx_place_net import read_onnx

    try:
        model = path.read_bytes()
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror}", "Give an ONNX file.") from None
    size, dimension, standardized = read_onnx(model, str(path))
    target = "sextant.models.onnx_place_net.OnnxPlaceNet"
    backbone = {"_target_": target, "length": len(model), "standardized": standardized}
    state = {"network.model": torch.from_numpy(np.frombuffer(model, np.uint8).copy())}
    return _content(path, "ONNX", backbone, state, size, dimension, standardized=standardized)


def card_text(card: dict[str, Any]) -> str:
    """What is known about a network that is not of Sextant, in one line."""
    values = "in [0, 1]" if card["mean"] is None else "with ImageNet's mean and deviation"
    return (
        f"{card['kind']}, {card['dimension']:,} numbers, images of {card['height']}x{card['width']} {values}; "
        f"{card['file']}, SHA-256 {card['sha256']}; not supplied by Sextant"
    )


def _safetensors(path: Path) -> Any:
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    from sextant.models.published_arrays import tensors_of
    from sextant.models.published_place_file import KNOWN, kind_of
    from sextant.models.weights_file import why_unread

    try:
        tensors = load_file(path)
    except FileNotFoundError:
        raise UserError(f"no checkpoint at {path}") from None
    except (OSError, SafetensorError, ValueError) as error:
        raise UserError(
            f"{path} cannot be read: {why_unread(error)}; and it has no card beside it, {path.stem}{ZOO_CARD}, as the "
            "models of Sextant have",
            "Copy the file again.",
        ) from None
    if kind_of(tensors_of(tensors) or {}) is None:
        raise UserError(
            f"{path} holds {len(tensors):,} arrays ({', '.join(list(tensors)[:3])}, ...), which are not those of a "
            f"place network that Sextant knows; it has no card beside it, {path.stem}{ZOO_CARD}, as its models have",
            f"Known: {KNOWN}",
        )
    return tensors


def _content(
    path: Path,
    kind: str,
    backbone: dict[str, Any],
    state: dict[str, Any],
    image_size: tuple[int, int],
    dimension: int,
    *,
    standardized: bool = True,
) -> dict[str, Any]:
    from sextant.models.trunk import IMAGENET_MEAN, IMAGENET_STD
    from sextant.runs.checkpoint import KEY, SCHEMA_VERSION

    size = {"height": image_size[0], "width": image_size[1]}
    card = {
        "kind": kind,
        "dimension": dimension,
        **size,
        "mean": list(IMAGENET_MEAN) if standardized else None,
        "std": list(IMAGENET_STD) if standardized else None,
        "file": path.name,
        "sha256": file_sha256(path),
    }
    return {
        KEY: {
            "schema_version": SCHEMA_VERSION,
            "config": _config(backbone, size, dimension),
            "spec": {"channels": 3, **size},
            "task": "place_recognition",
            CARD: card,
        },
        "state_dict": state,
    }


def _config(backbone: dict[str, Any], size: dict[str, int], dimension: int) -> dict[str, Any]:
    """What ``task=place_recognition dataset=place_folders`` composes, with this network."""
    return published_config(
        epochs=1,
        eval_batch_size=32,
        log_every=20,
        dataset={
            "_target_": "sextant.chapters.places.data.PlaceFolders",
            "folder": "places",
            "train": None,
            "val": None,
            "test": None,
            "places": "csv",
            "csv": "poses.csv",
            **size,
            "channels": 3,
            "skip_bad": False,
            "allow_duplicates": False,
        },
        backbone=backbone,
        pooling={"_target_": "sextant.models.pooling.Average"},
        loss={"_target_": "sextant.losses.InfoNCELoss", "temperature": 0.07},
        mining={"_target_": "sextant.retrieval.NoMining"},
        optimizer={
            "_target_": "torch.optim.AdamW",
            "_partial_": True,
            "lr": 0.001,
            "betas": [0.9, 0.999],
            "weight_decay": 0.01,
        },
        schedule={"_target_": "sextant.training.schedules.CosineDecay"},
        task={
            "name": "place_recognition",
            "dimension": dimension,
            "normalise": True,
            "layer": None,
            "batch_places": 32,
            "batch_conditions": 2,
            "tolerance": _tolerances(3.0, 15.0, 0.0, 5.0),
            "test_tolerance": _tolerances(25.0, 50.0, 1.0, 10.0),
            "train_conditions": None,
            "test_conditions": None,
            "shared_conditions": [],
            "augmentation": {"brightness": 0.0, "contrast": 0.0, "shift": 0.0, "mirror": False},
            "clip": 1.0,
            "whitening": None,
            "sequence_length": 10,
            "baselines": True,
            "off_the_shelf": None,
            "test_checkpoint": "last",
        },
    )


def _tolerances(near: float, far: float, near_frames: float, far_frames: float) -> dict[str, Any]:
    return {"m": _ring(near, far), "frames": _ring(near_frames, far_frames)}


def _ring(positive: float, negative: float) -> dict[str, Any]:
    return {"positive": positive, "negative": negative, "heading_deg": None}
