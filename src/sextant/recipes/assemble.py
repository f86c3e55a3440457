"""Parts that all recipes build from a config: the dataset, the test conditions, optimiser and schedule."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.config import Config
from sextant.config.building import build, part_name
from sextant.errors import UserError

if TYPE_CHECKING:
    from sextant.corruptions import CorruptionSuite


def build_dataset(config: Config) -> Any:
    """The dataset, which looks for files first in the data folder and then in the cache."""
    roots = dict.fromkeys([Path(config.paths.data), Path(config.paths.cache)])
    return build(config.plain, "dataset", roots=list(roots))


def build_suite(config: Config) -> "CorruptionSuite":
    """The test conditions."""
    return build(config.plain, "corruption")  # type: ignore[no-any-return]


def build_training(config: Config, *, training: bool) -> dict[str, Any]:
    """A module's training arguments: ``optimizer`` and ``schedule`` (None unless ``training``), and ``log_every``."""
    settings: dict[str, Any] = {"optimizer": None, "schedule": None, "log_every": config.trainer.log_every}
    if training:
        settings |= {"optimizer": build(config.plain, "optimizer"), "schedule": build(config.plain, "schedule")}
        _try_optimizer(config, settings["optimizer"])
    return settings


def conditions_name(node: Mapping[str, Any]) -> str:
    """A short name of the test conditions that a config node describes."""
    if "corruptions" in node:
        return ", ".join(["clean", *node["corruptions"]])
    return f"clean, {node.get('set') or part_name(node)}"


def _try_optimizer(config: Config, optimizer: Any) -> None:
    from torch import nn

    try:
        optimizer([nn.Parameter()])
    except (TypeError, ValueError) as error:
        raise UserError(f"optimizer: {config.optimizer.target} does not take these keys: {error}") from None
