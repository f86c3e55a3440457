"""Parts that all chapters build from a config: the dataset, the test conditions, optimiser and schedule."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.config import Config
from sextant.config.building import build, part_name
from sextant.config.schema.images import CorruptionSuite as CorruptionSuiteNode
from sextant.errors import UserError
from sextant.evaluation.headline import Headline
from sextant.registry import chapter_of

if TYPE_CHECKING:
    from sextant.corruptions import CorruptionSuite


#: package of the datasets of rendered worlds
WORLDS = "sextant.data.worlds."


def build_dataset(config: Config) -> Any:
    """The dataset, which searches for files first in the data folder and then in the cache.

    Raises:
        UserError: ``dataset.fit_world`` is set, and the task does not support it.
    """
    if config.plain["dataset"].get("fit_world") is not None and not chapter_of(config.task.name).fits_elsewhere:
        raise UserError(
            f"dataset.fit_world={config.plain['dataset']['fit_world']}: task={config.task.name} trains on separate "
            "towns, or on another part of the city",
            "Leave it out: it belongs to task=localization.",
        )
    return _built(config, config.plain["dataset"])


def fit_dataset(config: Config) -> Any | None:
    """The dataset of the world in which everything is fitted; None if that is the tested world."""
    node = config.plain["dataset"]
    return None if node.get("fit_world") is None else _built(config, {**node, "world": node["fit_world"]})


def _built(config: Config, node: Mapping[str, Any]) -> Any:
    roots = dict.fromkeys([Path(config.paths.data), Path(config.paths.cache)])
    return build({"dataset": _in_its_world(node)}, "dataset", roots=list(roots))


def _in_its_world(node: Any) -> Any:
    """A dataset's node with the number of a world replaced by its seed, at any depth."""
    if not isinstance(node, Mapping):
        return node
    plain = {key: _in_its_world(value) for key, value in node.items()}
    if not str(plain.get("_target_", "")).startswith(WORLDS):
        return plain
    world = plain.pop("world", None)
    plain.pop("fit_world", None)
    return plain if world is None else {**plain, "seed": world}


def build_suite(config: Config) -> "CorruptionSuite":
    """The test conditions."""
    return build(config.plain, "corruption")  # type: ignore[no-any-return]


def is_corrupted(config: Config) -> bool:
    """Whether there is a test condition other than clean images."""
    return not isinstance(config.corruption, CorruptionSuiteNode) or bool(config.corruption.corruptions)


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


def about_headline(config: Config, headline: Headline, size: tuple[int, int]) -> dict[str, Any]:
    """What a headline is, with the conditions and the height and width of the images that were corrupted."""
    return headline.facts(test=conditions_name(config.plain["corruption"]), image_size=list(size))


def _try_optimizer(config: Config, optimizer: Any) -> None:
    from torch import nn

    try:
        optimizer([nn.Parameter()])
    except (TypeError, ValueError) as error:
        raise UserError(f"optimizer: {config.optimizer.target} does not take these keys: {error}") from None
