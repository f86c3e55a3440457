"""The config that a trained network brings with it, before anything is built of it."""

from collections.abc import Mapping
from typing import Any

from sextant.config.schema import Config
from sextant.config.schema.parts import CustomPart
from sextant.config.validate import validate
from sextant.errors import UserError

#: keys of a backbone that name weights it starts from, and what stands there for none
STARTS_FROM = {"weights": None, "pretrained": False}


def without_weights(config: Config) -> Config:
    """The same network with new weights: a trained one brings its own, wherever those that it started from are now."""
    node = config.plain.get("backbone")
    if node is None or isinstance(config.backbone, CustomPart):
        return config
    none = {key: value for key, value in STARTS_FROM.items() if key in node}
    return validate({**config.plain, "backbone": {**node, **none}})


def trained_config(raw: Mapping[str, Any], task: str, *, trust: bool = False) -> Config:
    """The config of a checkpoint, typed.

    Args:
        raw: as plain values.
        task: that the checkpoint is labelled with.
        trust: allow parts that are not Sextant's.

    Raises:
        UserError: the config is wrong, label and config are of two tasks, or it names an import path that is not one of
            Sextant's: building it would run code that the file chose.
    """
    config = validate(raw)
    if task != config.task.name:
        raise UserError(
            f"this is a {task} model by its label and a {config.task.name} model by its config",
            "The checkpoint was altered, or written by another version of Sextant.",
        )
    if config.custom_targets() and not trust:
        raise UserError(
            f"the checkpoint wants to build {', '.join(config.custom_targets())}, which Sextant does not know",
            "If you know where the checkpoint comes from, add trust=true. Training takes no trust=: there, name a run "
            "in the folder of runs.",
        )
    return config
