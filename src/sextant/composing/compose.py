"""Composing a config with Hydra."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from contextvars import ContextVar
from copy import deepcopy
from string import Template
from typing import Any

import yaml
from hydra import compose as hydra_compose
from hydra import initialize_config_dir
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from sextant.composing.config_files import NO_GROUPS, folders, groups, search_path, unreadable_config_file
from sextant.composing.override_mistakes import COMPOSING, chosen, explain
from sextant.composing.overrides import literal, parse
from sextant.errors import UserError
from sextant.runs.outputs_folder import conf_dir, default_outputs

#: composed configs by choice of options, while :func:`composing_many` is open
_KEPT: ContextVar[dict[tuple[str, ...], DictConfig] | None] = ContextVar("kept compositions", default=None)


def register_resolvers() -> None:
    """Register ``${sextant.outputs:}`` and ``${sextant.here:}`` with OmegaConf."""
    OmegaConf.register_new_resolver("sextant.here", os.getcwd, replace=True)
    OmegaConf.register_new_resolver("sextant.outputs", lambda: str(default_outputs()), replace=True)


def compose(overrides: Sequence[str], name: str = "train", *, with_hydra: bool = False) -> DictConfig:
    """Compose the config ``name`` with ``overrides``, and ``with_hydra`` its own node too.

    Raises:
        UserError: an override is not understood, or a config file cannot be read. The message names it and, for an
            override, suggests what to write instead.
    """
    register_resolvers()
    inside_hydra = GlobalHydra.instance().is_initialized()
    with nullcontext() if inside_hydra else initialize_config_dir(str(conf_dir()), version_base="1.3"):
        try:
            words = [*map(literal, overrides), *search_path()]
            return hydra_compose(name, words, return_hydra_config=True) if with_hydra else _composed(words, name)
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise unreadable_config_file(chosen(overrides), error) or UserError(
                f"a config file cannot be read: {error}"
            ) from None
        except COMPOSING as error:
            raise explain(error, overrides, name) from None


@contextmanager
def composing_many() -> Iterator[None]:
    """Let :func:`compose` read the files of each choice of options only once, so that setting other values is fast.

    The files must not change while the context is open.
    """
    before = _KEPT.set({} if _KEPT.get() is None else _KEPT.get())
    try:
        yield
    finally:
        _KEPT.reset(before)


def _composed(overrides: Sequence[str], name: str) -> DictConfig:
    kept = _KEPT.get()
    if kept is None:
        return hydra_compose(name, overrides=list(overrides))
    known = groups()
    parsed = parse(overrides)
    values = [each for each in parsed if each.key not in known and not each.key.startswith("hydra")]
    choices = [each.text for each in parsed if each not in values]
    if (key := (name, *choices)) not in kept:
        kept[key] = hydra_compose(name, overrides=choices)
    config = deepcopy(kept[key])
    ConfigLoaderImpl._apply_overrides_to_config([each.parsed for each in values], config)
    return config


def run_help(overrides: Sequence[str]) -> str:
    """The help of a run as Hydra would print it: every group with its options, and the config of these overrides.

    Hydra copies its configuration once for each group, which takes longer than everything else.
    """
    config = compose(overrides, with_hydra=True)
    options: dict[str, set[str]] = {}
    for folder in folders():
        for path in folder.glob("*/**/*.yaml"):
            options.setdefault(path.parent.relative_to(folder).as_posix(), set()).add(path.stem)
    listed = "".join(
        f"{name}: {', '.join(sorted(found))}\n"
        for name, found in sorted(options.items())
        if name.split("/")[0] not in (*NO_GROUPS, "hydra")
    )
    template = Template(config.hydra.help.template)
    return template.substitute(APP_CONFIG_GROUPS=listed, CONFIG=shown(config))


def shown(config: DictConfig) -> str:
    """A composed config as YAML, without Hydra's own node."""
    return OmegaConf.to_yaml(OmegaConf.masked_copy(config, [str(key) for key in config if key != "hydra"]))


def to_plain(config: DictConfig) -> dict[str, Any]:
    """Convert a composed config to plain containers, with references resolved and without Hydra's own node.

    Raises:
        UserError: a value without a default is missing, or a reference cannot be resolved.
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
