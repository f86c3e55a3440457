"""Explains mistakes in overrides in the user's terms, by checking one override after the other."""

import re
import shlex
from collections.abc import Sequence
from typing import Any

from hydra import compose as hydra_compose
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from sextant.composing.config_files import groups, search_path, sweep_command, unreadable_config_file
from sextant.composing.overrides import Override, parse
from sextant.config import nearest, validate
from sextant.errors import UserError

COMPOSING = (HydraException, OmegaConfBaseException, ValueError)  # ValueError is raised for a group that is null
#: keys of other commands, and what the user may have meant
_METRICS = (
    "runs are logged to MLflow: tracking=sqlite (the default), server or none; "
    "tracking.also=[tensorboard,csv,wandb] adds other loggers"
)
_NETWORK = "the network is chosen by backbone=, such as backbone=resnet20"
ELSEWHERE = {
    "preset": "preset= is the size of a named sweep: -m sweep=pushpull_placement {0}",
    "logger": _METRICS,
    "wandb": _METRICS,
    "tensorboard": _METRICS,
    "model": _NETWORK,
    "net": _NETWORK,
    "network": _NETWORK,
    "data": "the data are chosen by dataset=, such as dataset=cifar10; the batch is trainer.batch_size",
    "datamodule": "the data are chosen by dataset=, such as dataset=cifar10; the batch is trainer.batch_size",
    "ckpt_path": "an interrupted run resumes by itself; init_from={1} starts from the weights of a run",
    "callbacks": "checkpoints and progress are automatic; trainer.patience=5 stops early",
    "hparams_search": "a search is a sweep: -m sweep.search=tpe 'optimizer.lr=log_uniform(1e-4, 1e-1)'",
    "run": "sextant evaluate {0} tests a trained model, sextant predict {0} input=<folder> output=<folder> applies it; "
    "init_from={1} starts training from its weights",
}


def explain(error: Exception, overrides: Sequence[str], name: str) -> UserError:
    """Find the mistake in ``overrides`` behind an error raised while composing the config ``name``."""
    values: list[Override] = []
    try:
        parsed = parse(overrides)
    except UserError as wrong:
        return wrong
    for override in parsed:
        if override.sweeps:
            return UserError(
                f"{override.text} lists several values",
                f"A sweep needs -m: {sweep_command(overrides)}",
            )
        key = override.key
        if key.split("/")[0] == "hydra" or key.startswith("hydra."):
            continue
        if key not in groups():
            values.append(override)
        elif (mistake := _wrong_option(override)) is not None:
            return mistake
    return (
        _wrong_value(values, overrides, name)
        or unreadable_config_file(chosen(overrides))
        or UserError(_first_line(error))
    )


def chosen(overrides: Sequence[str]) -> dict[str, str]:
    """The option that overrides choose from each group."""
    known = groups()
    words = (text.lstrip("+").partition("=") for text in overrides)
    return {key.partition("@")[0]: option for key, _, option in words if key.partition("@")[0] in known}


def _wrong_option(override: Override) -> UserError | None:
    """An error if an option does not exist in its group."""
    key, options = override.key, groups()[override.key]
    if override.deletes:
        return None
    if override.value is None:
        return UserError(f"{override.text}: a group cannot be null", f"Leave it out: '~{key}'")
    value = override.option
    if value in (*options, "null"):
        return None
    near = nearest(value, options)
    hint = f"Did you mean {key}={near}? " if near else ""
    return UserError(f"{key}={value}: no such option", f"{hint}Options: {', '.join(options)}")


def _wrong_value(values: Sequence[Override], overrides: Sequence[str], name: str) -> UserError | None:
    """An error if a key is not in the config that these overrides choose, or holds a value of another kind."""
    choices = [text for text in overrides if text.split("=")[0] in groups()]
    try:
        chosen = _composed(choices, name)
    except COMPOSING:
        return None
    for override in values:
        if override.key not in _flat(chosen):
            return _unknown_key(override, chosen, choices, name)
        text = override.text
        try:
            _composed([*choices, text], name)
        except COMPOSING as error:
            if (kind := _other_kind(override.key, override.value, chosen)) is not None:
                return UserError(f"{text}: {kind}", _how_to_set(override.key, chosen))
            return UserError(f"{text}: {_first_line(error)}")
    return None


def _unknown_key(override: Override, chosen: dict[str, Any], choices: Sequence[str], name: str) -> UserError:
    key, value = override.key, override.option
    if (group := key.split(".")[0]) in ELSEWHERE:
        return UserError(f"{key}={value}: unknown key", ELSEWHERE[group].format(shlex.quote(f"{key}={value}"), value))
    known = _flat(chosen)
    near = nearest(key, [*known, *groups()]) or nearest(key.rsplit(".", 1)[-1], [*known, *groups()])
    if near is not None:
        return UserError(f"{key}={value}: unknown key", _suggestion(near, override, chosen, choices, name))
    siblings = [k for k in known if k.startswith(key.split(".", maxsplit=1)[0] + ".")] if "." in key else []
    told = f"Keys there: {', '.join(siblings)}" if siblings else f"Groups: {', '.join(groups())}"
    return UserError(f"{key}={value}: unknown key", told)


def _suggestion(near: str, override: Override, chosen: dict[str, Any], choices: Sequence[str], name: str) -> str:
    """The key that was probably meant, with the value if it is legal there."""
    value = override.option
    if near in groups():
        fits = value in groups()[near]
        return f"Did you mean {near}={value}?" if fits else f"Did you mean {near}? Options: {', '.join(groups()[near])}"
    if (kind := _other_kind(near, override.value, chosen)) is not None:
        return f"Did you mean {near}? It {kind}. {_how_to_set(near, chosen)}"
    try:
        validate(_composed([*choices, f"{near}={value}"], name))
    except UserError as error:
        told = next((line for line in error.problem.splitlines() if line.startswith(near)), None)
        if told is not None:
            return f"Did you mean {near}? There, {told}"
    except COMPOSING:
        return f"Did you mean {near}?"
    return f"Did you mean {near}={value}?"


def _other_kind(key: str, value: Any, chosen: dict[str, Any]) -> str | None:
    """What a key holds, if it is keys or a list and ``value`` is the other; else None."""
    held = _flat(chosen)[key]
    if isinstance(held, dict) and isinstance(value, list):
        return f"holds the keys {', '.join(map(str, held))}, not a list"
    if isinstance(held, list) and isinstance(value, dict):
        return "holds a list, not keys"
    return None


def _how_to_set(key: str, chosen: dict[str, Any]) -> str:
    held = _flat(chosen)[key]
    if isinstance(held, dict):
        inner, value = next(
            ((k, v) for k, v in held.items() if not isinstance(v, dict | list)), (next(iter(held), "<key>"), "<value>")
        )
        return f"Set one of them, for example {key}.{inner}={value}; a file in conf/ can hold anything else."
    return f"Write a list, {key}=[..]; a file in conf/ can hold anything else."


def _composed(overrides: Sequence[str], name: str) -> dict[str, Any]:
    composed = OmegaConf.to_container(hydra_compose(name, overrides=[*overrides, *search_path()]), resolve=False)
    assert isinstance(composed, dict)
    return {str(key): value for key, value in composed.items()}


def _flat(node: Any, prefix: str = "") -> dict[str, Any]:
    """Everything within a node by its dotted key, including nested nodes themselves."""
    if not isinstance(node, dict):
        return {}
    found: dict[str, Any] = {}
    for name, value in node.items():
        found |= {f"{prefix}{name}": value} | _flat(value, f"{prefix}{name}.")
    return found


def _first_line(error: Exception) -> str:
    first = next((line for line in str(error).splitlines() if line.strip()), type(error).__name__)
    return re.sub(r"\s+", " ", first)
