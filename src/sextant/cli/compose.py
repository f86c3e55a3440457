"""Composing a config with Hydra, and telling what is wrong with an override in the user's terms."""

import re
from collections.abc import Sequence
from contextlib import nullcontext
from functools import cache
from typing import Any

from hydra import compose as hydra_compose
from hydra import initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException, OverrideParseException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from sextant.config import nearest
from sextant.errors import UserError
from sextant.runs.outputs_folder import conf_dir, default_outputs


def register_resolvers() -> None:
    """Make ``${sextant.outputs:}`` known to OmegaConf."""
    OmegaConf.register_new_resolver("sextant.outputs", lambda: str(default_outputs()), replace=True)


def compose(overrides: Sequence[str], name: str = "train") -> DictConfig:
    """Compose the config ``name`` with ``overrides``.

    Raises:
        UserError: an override is not understood; names it, what is near it, and what to write instead.
    """
    register_resolvers()
    inside_hydra = GlobalHydra.instance().is_initialized()
    with nullcontext() if inside_hydra else initialize_config_dir(str(conf_dir()), version_base="1.3"):
        try:
            return hydra_compose(name, overrides=list(overrides))
        except (HydraException, OmegaConfBaseException, ValueError) as error:  # the last for a group that is null
            raise _explain(error, overrides, name) from None


def to_plain(config: DictConfig) -> dict[str, Any]:
    """A composed config as plain containers, every reference resolved, without Hydra's own node.

    Raises:
        UserError: a value that has no default is missing, or a reference cannot be resolved.
    """
    try:
        plain = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    except MissingMandatoryValue as error:
        key = str(error.full_key or "")
        raise UserError(f"{key} has no default and must be given", f"For example {key}=<value>") from None
    except OmegaConfBaseException as error:
        raise UserError(f"{error.full_key}: {str(error).splitlines()[0]}") from None
    assert isinstance(plain, dict)
    return {str(key): value for key, value in plain.items() if key != "hydra"}


@cache
def groups() -> dict[str, tuple[str, ...]]:
    """Options of every config group, such as ``{"dataset": ("cifar10", "digits", ...)}``."""
    found: dict[str, list[str]] = {}
    for path in sorted(conf_dir().glob("*/*.yaml")):
        found.setdefault(path.parent.name, []).append(path.stem)
    return {name: tuple(options) for name, options in found.items()}


def _explain(error: Exception, overrides: Sequence[str], name: str) -> UserError:
    """The mistake behind an error of Hydra's, found by looking at one override after the other."""
    for text in overrides:
        try:
            (override,) = OverridesParser.create().parse_overrides([text])
        except OverrideParseException:
            return UserError(
                f"{text!r} is not a key=value override",
                "Write key=value without spaces; quote values with special characters: 'key=\"a, b\"'",
            )
        if override.is_sweep_override():
            return UserError(
                f"{text} lists several values", f"A sweep needs -m: python train.py -m {' '.join(overrides)}"
            )
        key, value = override.key_or_group, override.get_value_element_as_str() if override.value() is not None else ""
        if key in groups() and override.value() is None and not override.is_delete():
            return UserError(f"{text}: a group cannot be null", f"Leave it out: '~{key}'")
        if key.split("/")[0] == "hydra" or key.startswith("hydra."):
            continue
        if key in groups():
            options = groups()[key]
            if not override.is_delete() and value not in (*options, "null"):
                near = nearest(value, options)
                hint = f"Did you mean {key}={near}? " if near else ""
                return UserError(f"{key}={value}: no such option", f"{hint}Options: {', '.join(options)}")
            continue
        unknown = _unknown_key(key, value, overrides, name)
        if unknown is not None:
            return unknown
    first = next((line for line in str(error).splitlines() if line.strip()), type(error).__name__)
    return UserError(re.sub(r"\s+", " ", first))


def _unknown_key(key: str, value: str, overrides: Sequence[str], name: str) -> UserError | None:
    """An error if no config that these overrides choose has ``key``."""
    choices = [text for text in overrides if text.split("=")[0] in groups()]
    try:
        known = _flat_keys(OmegaConf.to_container(hydra_compose(name, overrides=choices), resolve=False))
    except (HydraException, OmegaConfBaseException, ValueError):
        return None
    if key in known:
        return None
    near = nearest(key, [*known, *groups()]) or nearest(key.rsplit(".", 1)[-1], [*known, *groups()])
    if near is None and "." in key:
        siblings = [k for k in known if k.startswith(key.split(".", maxsplit=1)[0] + ".")]
        near_text = f"Keys there: {', '.join(siblings)}" if siblings else ""
    else:
        near_text = f"Did you mean {near}={value}?" if near else f"Groups: {', '.join(groups())}"
    return UserError(f"{key}={value}: unknown key", near_text or f"Groups: {', '.join(groups())}")


def _flat_keys(node: Any, prefix: str = "") -> list[str]:
    if not isinstance(node, dict):
        return []
    keys = []
    for name, value in node.items():
        keys.append(f"{prefix}{name}")
        keys += _flat_keys(value, f"{prefix}{name}.")
    return keys
