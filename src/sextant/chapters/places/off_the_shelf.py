"""A layer of an off-the-shelf network as a baseline place descriptor, built from a config.

Checks made before training import nothing heavy.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sextant.atomic_files import file_sha256
from sextant.chapters.places.config import OffTheShelf
from sextant.errors import ArgumentError, UserError
from sextant.user_files import absent

if TYPE_CHECKING:
    from torch import nn

    from sextant.baselines.network_layer import NetworkLayer

KEY = "task.off_the_shelf"


@dataclass(frozen=True)
class _Trained:
    """A trained network, with its name, input channels, and the mean and deviation that standardise its images."""

    name: str
    network: "nn.Module"
    channels: int
    mean: Sequence[float]
    std: Sequence[float]


def weights_identity(shelf: OffTheShelf, outputs: Path) -> str:
    """The hash of the weights file, whatever its path. Imports nothing heavy, so that mistakes are reported at once.

    Raises:
        UserError: the file or run does not exist.
    """
    if shelf.network is None:
        from sextant.runs.resolve import resolve_run

        return resolve_run(shelf.weights, outputs, f"{KEY}.weights").identity
    if shelf.weights == "imagenet":
        return shelf.weights
    path = Path(shelf.weights).expanduser()
    if not path.is_file():
        raise UserError(
            f"{KEY}.weights={absent(path)}",
            f"Give the state dict of a {shelf.network}, or weights: imagenet, to download them. "
            "For a run of Sextant, or a published .pth.tar, leave out network.",
        )
    return file_sha256(path)


def off_the_shelf(shelf: OffTheShelf, image_size: tuple[int, int], outputs: Path) -> "tuple[str, NetworkLayer]":
    """The name and the descriptor that a config chooses; a name is ``off the shelf: alexnet features.7``.

    Args:
        shelf: the config.
        image_size: height and width of the images, used for the descriptor unless the config gives a size.
        outputs: folder of runs.

    Raises:
        UserError: the network, file, run or layer does not exist, or the weights do not belong to the network.
    """
    from torch import nn

    from sextant.baselines.network_layer import NetworkLayer
    from sextant.models import FeatureMap
    from sextant.models.standardize import Standardize

    size = image_size if shelf.size is None else (shelf.size[0], shelf.size[1])
    weights_identity(shelf, outputs)
    with _naming_the_key():
        found = _run(shelf, outputs) if shelf.network is None else _classifier(shelf.network, shelf.weights, size)
        features = FeatureMap(found.network, found.channels, size, layer=shelf.layer)
    layer = NetworkLayer(
        nn.Sequential(Standardize(found.channels, found.mean, found.std), features),
        *size,
        channels=found.channels,
        grid=(shelf.grid[0], shelf.grid[1]),
        dimensions=shelf.dimension,
    )
    return f"off the shelf: {found.name} {features.layer}", layer


def _run(shelf: OffTheShelf, outputs: Path) -> _Trained:
    """The network of a run, a checkpoint or a published file, which standardises its images itself."""
    from sextant.kit.trained import own_config, read_trained, trained_network
    from sextant.registry import offering
    from sextant.runs.checkpoint import KEY as CONTENT
    from sextant.runs.resolve import resolve_run

    path = resolve_run(shelf.weights, outputs, f"{KEY}.weights").checkpoint
    content = read_trained(path)
    config = own_config(content[CONTENT])
    tasks = offering("new_network")
    if (task := content[CONTENT]["task"]) not in tasks:
        raise UserError(
            f"{KEY}.weights={shelf.weights} is a model of task={task}, which has no feature map",
            f"Name a run of task={' or task='.join(tasks)}.",
        )
    channels = int(content[CONTENT]["spec"].get("channels", 3))
    backbone = config.plain["backbone"]
    name = str(backbone.get("name") or str(backbone["_target_"]).rsplit(".", 1)[-1])
    network = trained_network(config, content, path)
    return _Trained(name, network, channels, (0.0,) * channels, (1.0,) * channels)


def _classifier(name: str, weights: str, size: tuple[int, int]) -> _Trained:
    """A classifier of torchvision or else timm, with its own classes and weights from a file or the Internet."""
    from torchvision import models

    from sextant.models import timm_backbone
    from sextant.models.torchvision_backbone import torchvision_classifier
    from sextant.models.trunk import IMAGENET_MEAN, IMAGENET_STD
    from sextant.models.weights_file import load_weights

    if name in models.list_models(models):
        return _Trained(name, torchvision_classifier(name, weights), 3, IMAGENET_MEAN, IMAGENET_STD)
    fetched = weights == "imagenet"
    network = timm_backbone(name, 3, size, 1000, pretrained=fetched)
    if not fetched:
        load_weights(network, Path(weights).expanduser())
    settings = getattr(network, "pretrained_cfg", {})
    return _Trained(name, network, 3, settings.get("mean", IMAGENET_MEAN), settings.get("std", IMAGENET_STD))


@contextmanager
def _naming_the_key() -> Iterator[None]:
    """Add the config key to errors that are raised elsewhere."""
    try:
        yield
    except UserError as error:
        keys = {"name": f"{KEY}.network", "weights": f"{KEY}.weights"}
        told = error.named(keys) if isinstance(error, ArgumentError) else error
        raise UserError(told.problem if told.problem.startswith(KEY) else f"{KEY}: {told.problem}", told.fix) from None
