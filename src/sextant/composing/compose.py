"""Composing a config with Hydra."""

from collections.abc import Sequence
from contextlib import nullcontext
from typing import Any

import yaml
from hydra import compose as hydra_compose
from hydra import initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from sextant.composing.config_files import search_path, unreadable_config_file
from sextant.composing.override_mistakes import COMPOSING, explain
from sextant.errors import UserError
from sextant.runs.outputs_folder import conf_dir, default_outputs


def register_resolvers() -> None:
    """Make ``${sextant.outputs:}`` known to OmegaConf."""
    OmegaConf.register_new_resolver("sextant.outputs", lambda: str(default_outputs()), replace=True)


def compose(overrides: Sequence[str], name: str = "train") -> DictConfig:
    """Compose the config ``name`` with ``overrides``.

    Raises:
        UserError: an override is not understood; names it, what is near it, and what to write instead. Or a config file
            cannot be read; names it.
    """
    register_resolvers()
    inside_hydra = GlobalHydra.instance().is_initialized()
    with nullcontext() if inside_hydra else initialize_config_dir(str(conf_dir()), version_base="1.3"):
        try:
            return hydra_compose(name, overrides=[*overrides, *search_path()])
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise unreadable_config_file() or UserError(f"a config file cannot be read: {error}") from None
        except COMPOSING as error:
            raise explain(error, overrides, name) from None


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
