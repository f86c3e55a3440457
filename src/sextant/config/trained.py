"""Checks of the config that comes with a trained network, before anything is built from it."""

from collections.abc import Mapping
from typing import Any

from sextant.config.schema import Config
from sextant.config.schema.parts import CustomPart
from sextant.config.validate import validate
from sextant.errors import UserError

#: keys of a backbone that name its initial weights, with the values for none
STARTS_FROM = {"weights": None, "pretrained": False}


def without_weights(config: Config) -> Config:
    """The same network without initial weights, as a trained one has its own and the initial ones may be gone."""
    node = config.plain.get("backbone")
    if node is None or isinstance(getattr(config, "backbone", None), CustomPart):
        return config
    none = {key: value for key, value in STARTS_FROM.items() if key in node}
    return validate({**config.plain, "backbone": {**node, **none}})


def trained_config(raw: Mapping[str, Any], task: str, *, trust: bool = False, what: str = "the checkpoint") -> Config:
    """Validate the config of a checkpoint.

    Args:
        raw: the config as plain values.
        task: task in the checkpoint's label.
        trust: allow parts from outside Sextant.
        what: what the config comes from, for messages.

    Raises:
        UserError: the config is invalid, label and config name different tasks, or the config names an import path
            outside Sextant, which would run code chosen by the file.
    """
    config = validate(raw)
    if task != config.task.name:
        raise UserError(
            f"this is a {task} model by its label and a {config.task.name} model by its config",
            "The checkpoint was altered, or written by another version of Sextant.",
        )
    if config.custom_targets() and not trust:
        raise UserError(
            f"{what} names import paths outside Sextant: {', '.join(config.custom_targets())}",
            f"If you know where {what} comes from, add trust=true. Training takes no trust=: there, name a run "
            "in the folder of runs.",
        )
    return config
