"""The features of a trained network on which a filter operates."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import nn

from sextant.errors import UserError
from sextant.kit.trained import own_config, read_trained, trained_network
from sextant.models import FeatureMap
from sextant.registry import offering
from sextant.runs.checkpoint import KEY
from sextant.runs.resolve import resolve_run
from sextant.torch_file import building


@dataclass(frozen=True)
class TrainedFeatures:
    """A layer of a trained network.

    Attributes:
        features: maps images in [0, 1] to its feature map.
        size: channels of the feature map.
        channels: channels of the images.
        facts: run, checkpoint and layer, for the files that are written.
    """

    features: nn.Module
    size: int
    channels: int
    facts: Mapping[str, Any]


def trained_features(reference: str, outputs: Path, layer: str | None, *, trust: bool) -> TrainedFeatures:
    """The features of a classification or place-recognition run.

    Args:
        reference: the run, see :func:`~sextant.runs.resolve.resolve_run`.
        outputs: folder of runs.
        layer: layer whose output is used; by default the one that place descriptors are made of, or the last feature
            map of a classifier, if that has a usual name.
        trust: build user-defined parts that the checkpoint names.

    Raises:
        UserError: there is no such run or layer (those that exist are listed), or its task has no such network.
    """
    found = resolve_run(reference, outputs)
    content = read_trained(found.checkpoint)
    trained = content[KEY]
    tasks = offering("new_network")
    if trained["task"] not in tasks:
        raise UserError(
            f"run={reference} is a model of {trained['task']}; features are taken from {' or '.join(tasks)}",
            "Name such a run, or leave run= out: preset= needs none.",
        )
    config = own_config(trained, trust=trust)
    network = trained_network(config, content, found.checkpoint)
    spec = trained["spec"]
    before: nn.Module = nn.Identity()
    if trained["task"] == "place_recognition":
        before, network = network.standardize, network.backbone
        if isinstance(network, FeatureMap):  # nested, the outer one would never see its layer
            layer, network = layer or network.layer, network.network
    with building():  # it tries an image
        features = FeatureMap(network, spec["channels"], (spec["height"], spec["width"]), layer=layer)
    whole = nn.Sequential(before, features).eval().requires_grad_(False)
    facts = {"run": reference, "sha256": found.identity, "task": trained["task"], "layer": features.layer}
    return TrainedFeatures(whole, features.channels, spec["channels"], facts)
