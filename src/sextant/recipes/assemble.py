"""From a config to objects: the only place that builds what ``_target_`` names."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydra.errors import HydraException
from hydra.utils import instantiate

from sextant.config import Config
from sextant.errors import ArgumentError, UserError

if TYPE_CHECKING:
    from sextant.corruptions import CorruptionSuite


def build(raw: Mapping[str, Any], group: str, **arguments: Any) -> Any:
    """Build the object that the config of ``group`` describes, with further ``arguments``.

    Raises:
        UserError: the import path does not exist, or the object does not take these arguments.
    """
    node = raw[group]
    try:
        if not arguments:
            return instantiate(node, _convert_="all")
        # not through Hydra, which would make containers of objects that are passed
        return instantiate(node, _convert_="all", _partial_=True)(**arguments)
    except ArgumentError as error:
        raise error.within(group, node) from None
    except UserError:
        raise
    except (HydraException, TypeError, ValueError, ImportError) as error:
        cause = error.__cause__ if isinstance(error, HydraException) and error.__cause__ is not None else error
        if isinstance(cause, UserError):
            raise (cause.within(group, node) if isinstance(cause, ArgumentError) else cause) from None
        reason = str(cause).splitlines()[0]
        raise UserError(
            f"{group}: {node.get('_target_')} cannot be built: {reason}",
            f"It is called with the keys of {group}" + (f" and {', '.join(arguments)}" if arguments else ""),
        ) from None


@contextmanager
def naming_groups(raw: Mapping[str, Any]) -> Iterator[None]:
    """Say of a mistake in an argument, found long after its part was built, which group of the config it is in."""
    try:
        yield
    except ArgumentError as error:
        for group, node in raw.items():
            if isinstance(node, Mapping) and str(node.get("_target_", "")).rpartition(".")[-1] == error.of:
                raise error.within(group, node) from None
        raise


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


def part_name(node: Mapping[str, Any]) -> str:
    """The class that a config node names, with its settings."""
    name = str(node["_target_"]).rsplit(".", 1)[-1]
    settings = ", ".join(f"{key}={value}" for key, value in node.items() if not key.startswith("_"))
    return f"{name}({settings})"


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
