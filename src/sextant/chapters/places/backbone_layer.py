"""A descriptor from the groups ``backbone``, ``inhibition`` and ``pooling``: a network that is not trained here."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import torch
from jaxtyping import Float
from pydantic import TypeAdapter, ValidationError
from torch import Tensor, nn

from sextant.baselines.network_layer import NetworkLayer
from sextant.chapters.places.config import Descriptor, Pooling
from sextant.config.building import build
from sextant.config.schema.networks import Backbone, Inhibition
from sextant.config.schema.parts import Choice, CustomPart
from sextant.config.trained import STARTS_FROM
from sextant.errors import UserError
from sextant.models import FeatureMap
from sextant.models.standardize import Standardize
from sextant.models.timm_backbone import timm_statistics
from sextant.models.trunk import IMAGENET_MEAN, IMAGENET_STD, TrunkInput
from sextant.torch_file import building

#: groups that define the descriptor, with the kinds of their parts; only the first two are needed
GROUPS: dict[str, type[Any]] = {
    "descriptor": Descriptor,
    "backbone": Backbone,
    "inhibition": Inhibition,
    "pooling": Pooling,
}
CHANNELS = 3


class PooledMap(nn.Module):
    """A feature map pooled to a vector, as a map of one cell.

    >>> from sextant.models.pooling import Average
    >>> PooledMap(nn.Identity(), Average(2, (4, 4)))(torch.ones(5, 2, 4, 4)).shape
    torch.Size([5, 2, 1, 1])
    """

    def __init__(self, features: nn.Module, pooling: nn.Module):
        super().__init__()
        self.features, self.pooling = features, pooling

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d 1 1"]:
        """The vector of each image."""
        return self.pooling(self.features(x))[:, :, None, None]  # type: ignore[no-any-return]


def untrained_map(
    plain: Mapping[str, Any],
    channels: int,
    size: tuple[int, int],
    layer: str | None,
    *,
    trained: bool | None = None,
) -> FeatureMap:
    """The map of the groups ``backbone`` and ``inhibition``, with pretrained weights or new ones.

    Images of a pretrained network of torchvision or timm are standardised by ImageNet's statistics, for transformers by
    those of timm's weights; other networks standardise images themselves, or take them in [0, 1].

    Args:
        plain: these groups as plain values.
        channels, size: of the images.
        layer: whose map is taken; None for the default.
        trained: whether the weights are those of ImageNet or a file; None: as in the config of the backbone.

    Raises:
        UserError: a part cannot be built, the layer does not exist, or the inhibition does not fit the backbone.
    """
    network = build(plain, "backbone", in_channels=channels, image_size=size, num_classes=2)
    features = FeatureMap(network, channels, size, layer=layer)
    if plain.get("inhibition") is not None:
        try:
            features = build(plain, "inhibition")(features)
        except ValueError as error:
            raise UserError(f"inhibition: {error}", "Choose another backbone, or inhibition=none") from None
    trained = brings_weights(plain["backbone"]) if trained is None else trained
    if trained and not any(isinstance(module, TrunkInput) for module in network.modules()):
        mean, std = statistics(plain["backbone"] if features.tokens is not None else {}, channels)
        features.network = nn.Sequential(Standardize(channels, mean, std), features.network)
        features.layer = f"1.{features.layer}"
    return features.eval()


def backbone_layer(plain: Mapping[str, Any], *, trained: bool | None = None) -> NetworkLayer:
    """Build the descriptor: the map of the backbone with its inhibition, averaged over cells or pooled, then whitened.

    Weights that are not pretrained are drawn with ``descriptor.seed``.

    Args:
        plain: the groups of :data:`GROUPS` as plain values, or a whole config.
        trained: as for :func:`untrained_map`.

    Raises:
        UserError: a part cannot be built, the layer does not exist, or the inhibition does not fit the backbone.
    """
    node = plain["descriptor"]
    size = int(node["height"]), int(node["width"])
    with building():
        torch.manual_seed(node["seed"])
        found = untrained_map(plain, CHANNELS, size, node["layer"], trained=trained)
        features: nn.Module = found
        pooled = plain.get("pooling") is not None
        if pooled:
            features = PooledMap(found, build(plain, "pooling", channels=found.channels, size=found.size))
    grid = (1, 1) if pooled else (int(node["grid"][0]), int(node["grid"][1]))
    return NetworkLayer(features, *size, channels=CHANNELS, grid=grid, dimensions=node["dimensions"])


def layer_nodes(plain: Mapping[str, Any]) -> dict[str, Any]:
    """The groups of a config that define the descriptor, as plain values that JSON can hold."""
    found: dict[str, Any] = json.loads(json.dumps({group: plain.get(group) for group in GROUPS}))
    return found


def layer_identity(layer: NetworkLayer, nodes: Mapping[str, Any]) -> str:
    """A hash of the parts and of the network's weights."""
    hashed = hashlib.sha256(json.dumps(nodes, sort_keys=True).encode())
    for name, value in sorted(layer.features.state_dict().items()):
        hashed.update(name.encode() + value.detach().cpu().contiguous().numpy().tobytes())
    return hashed.hexdigest()


def layer_of_file(nodes: Mapping[str, Any], weights: Mapping[str, Tensor], *, trust: bool) -> NetworkLayer:
    """The descriptor stored in a file; its parts are validated like those of a config.

    Raises:
        UserError: the file names parts from outside Sextant and ``trust`` is false.
        ValueError: a part does not belong to its group, or the weights do not fit or are not finite.
    """
    checked = {}
    for group, kind in GROUPS.items():
        if nodes.get(group) is None:
            continue
        try:
            part = TypeAdapter(Choice[kind]).validate_python(nodes[group])  # type: ignore[misc,valid-type]
        except ValidationError as error:
            raise ValueError(f"{group} is invalid: {error.errors()[0]['msg']}") from None
        if isinstance(part, CustomPart) and not trust:
            raise UserError(
                f"the descriptor wants to build {part.target}, which Sextant does not know",
                "If you know where it comes from, add trust=true.",
            )
        checked[group] = nodes[group]
    backbone = checked["backbone"]
    checked["backbone"] = {**backbone, **{key: none for key, none in STARTS_FROM.items() if key in backbone}}
    layer = backbone_layer(checked, trained=brings_weights(backbone))
    if bad := [name for name, value in weights.items() if value.is_floating_point() and not value.isfinite().all()]:
        raise ValueError(f"weights that are not finite: {bad[0]}")
    try:
        layer.features.load_state_dict(dict(weights))
    except RuntimeError as error:
        raise ValueError(str(error).splitlines()[0]) from None
    return layer


def statistics(backbone: Mapping[str, Any], channels: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Mean and deviation of the images on which the weights of a timm network were trained; ImageNet's for others."""
    found: tuple[tuple[float, ...], tuple[float, ...]] = IMAGENET_MEAN, IMAGENET_STD
    if backbone.get("_target_") == "sextant.models.timm_backbone":
        found = timm_statistics(backbone["name"])
    mean, std = (each if channels == 3 else (sum(each) / len(each),) * channels for each in found)
    return mean, std


def brings_weights(backbone: Mapping[str, Any]) -> bool:
    """Whether the config of a backbone names weights to start from."""
    return any(backbone.get(key) not in (None, False) for key in STARTS_FROM)
