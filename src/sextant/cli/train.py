"""``train.py``: one run, or with ``-m`` a sweep."""

import os
import sys
from collections.abc import Sequence
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig

from sextant.cli.console import reporting_mistakes
from sextant.cli.terminal import TERMINAL
from sextant.composing.compose import compose, register_resolvers, to_plain
from sextant.composing.config_files import own_configs
from sextant.errors import UserError
from sextant.lifecycle.checks import checked, preflight
from sextant.runs.outputs_folder import conf_dir
from sextant.tracking.environment import quiet_libraries

MULTIRUN = ("-m", "--multirun")
#: Flags with which Hydra only prints something.
ONLY_PRINT = ("--help", "-h", "--hydra-help", "--version", "--cfg", "-c", "--info", "-i", "--shell-completion", "-sc")

#: those of them that print the config of a run, which has to be one that would be run
PRINT_CONFIG = ("--cfg", "-c")
#: the flag that names a folder of config files of one's own
CONFIG_DIR = ("--config-dir", "-cd")


def main(arguments: Sequence[str]) -> None:
    """Check everything that can be checked lightly, then hand over to Hydra."""
    quiet_libraries()
    register_resolvers()
    words, folder = _without_config_dir(arguments)
    sys.argv = [sys.argv[0], *words]
    if folder is not None:
        sys.argv += ["--config-dir", folder]
    with own_configs(folder):
        _check(words)
        hydra.main(config_path=str(conf_dir()), config_name="train", version_base="1.3")(run_config)()


def _check(arguments: Sequence[str]) -> None:
    """Find mistakes in the arguments before anything heavy is imported."""
    printing = [argument for argument in arguments if argument.split("=")[0] in ONLY_PRINT]
    sweeping = any(argument in MULTIRUN for argument in arguments)
    if printing and sweeping:
        raise UserError(f"{printing[0]} prints something about one run, -m starts many", "Leave one of them out.")
    if printing:
        if printing[0].split("=")[0] in PRINT_CONFIG:
            overrides = [word for word in arguments if ("=" in word or "~" in word) and not word.startswith("-")]
            checked(to_plain(compose(overrides)))
        return
    overrides = [argument for argument in arguments if not argument.startswith("-")]
    if sweeping:
        from sextant.lifecycle.sweep_plan import check_sweep_overrides

        check_sweep_overrides(overrides)
        os.environ.setdefault("HYDRA_FULL_ERROR", "1")
    else:
        preflight(overrides, TERMINAL)


def _without_config_dir(arguments: Sequence[str]) -> tuple[list[str], str | None]:
    """The other arguments, and the folder that ``--config-dir`` names."""
    words, folder, rest = [], None, iter(arguments)
    for word in rest:
        flag, equals, value = word.partition("=")
        if flag in CONFIG_DIR:
            folder = value if equals else next(rest, "")
        else:
            words.append(word)
    return words, folder


def run_config(config: DictConfig) -> dict[str, Any] | None:
    """What Hydra calls for every run: a single one ends the process, a cell of a sweep returns its outcome."""
    quiet_libraries()
    from sextant.cli.show import show_result
    from sextant.lifecycle.execute import execute, execute_cell
    from sextant.lifecycle.workers import end_with_controller

    raw = to_plain(config)
    if HydraConfig.get().mode == RunMode.MULTIRUN:
        end_with_controller()
        return execute_cell(raw, TERMINAL)
    with reporting_mistakes():
        show_result(execute(raw, reporter=TERMINAL))
    return None
