"""What all recipes build of a config: the dataset, the test conditions, what a module trains with."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.config import Config
from sextant.config.building import build, part_name
from sextant.errors import UserError

if TYPE_CHECKING:
    from sextant.corruptions import CorruptionSuite


def build_dataset(raw: Mapping[str, Any], config: Config) -> Any:
    """The dataset, which looks in the data folder first and in the cache second."""
    return build(raw, "dataset", roots=list(dict.fromkeys([Path(config.paths.data), Path(config.paths.cache)])))


def build_suite(raw: Mapping[str, Any]) -> "CorruptionSuite":
    """The test conditions."""
    return build(raw, "corruption")  # type: ignore[no-any-return]


def build_training(raw: Mapping[str, Any], training: bool) -> dict[str, Any]:
    """What a module trains with: ``optimizer`` and ``schedule``, both None unless ``training``, and ``log_every``."""
    settings: dict[str, Any] = {"optimizer": None, "schedule": None, "log_every": raw["trainer"]["log_every"]}
    if training:
        settings |= {"optimizer": build(raw, "optimizer"), "schedule": build(raw, "schedule")}
        _try_optimizer(raw, settings["optimizer"])
    return settings


def conditions_name(node: Mapping[str, Any]) -> str:
    """The test conditions that a config node describes, in short."""
    if "corruptions" in node:
        return ", ".join(["clean", *node["corruptions"]])
    return f"clean, {node.get('set') or part_name(node)}"


def _try_optimizer(raw: Mapping[str, Any], optimizer: Any) -> None:
    from torch import nn

    try:
        optimizer([nn.Parameter()])
    except (TypeError, ValueError) as error:
        raise UserError(f"optimizer: {raw['optimizer']['_target_']} does not take these keys: {error}") from None
