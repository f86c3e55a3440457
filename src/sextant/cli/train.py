"""``train.py``: one run, or with ``-m`` a sweep."""

import os
import sys
from collections.abc import Sequence
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig

from sextant.cli.compose import compose, register_resolvers, to_plain
from sextant.cli.console import reporting_mistakes
from sextant.errors import UserError
from sextant.lifecycle.checks import checked
from sextant.runs.outputs_folder import conf_dir
from sextant.tracking.environment import quiet_libraries

MULTIRUN = ("-m", "--multirun")
#: Flags with which Hydra only prints something.
ONLY_PRINT = ("--help", "-h", "--hydra-help", "--version", "--cfg", "-c", "--info", "-i", "--shell-completion", "-sc")

#: those of them that print the config of a run, which has to be one that would be run
PRINT_CONFIG = ("--cfg", "-c")


def main(arguments: Sequence[str]) -> None:
    """Check everything that can be checked lightly, then hand over to Hydra."""
    quiet_libraries()
    register_resolvers()
    sys.argv = [sys.argv[0], *arguments]
    printing = [argument for argument in arguments if argument.split("=")[0] in ONLY_PRINT]
    if printing and any(argument in MULTIRUN for argument in arguments):
        raise UserError(f"{printing[0]} prints something about one run, -m starts many", "Leave one of them out.")
    if printing:
        if printing[0].split("=")[0] in PRINT_CONFIG:
            overrides = [word for word in arguments if ("=" in word or "~" in word) and not word.startswith("-")]
            checked(to_plain(compose(overrides)))
        return _hydra_main()
    overrides = [argument for argument in arguments if not argument.startswith("-")]
    if any(argument in MULTIRUN for argument in arguments):
        from sextant.cli.sweep_plan import check_sweep_overrides

        check_sweep_overrides(overrides)
        os.environ.setdefault("HYDRA_FULL_ERROR", "1")
    else:
        preflight(overrides)
    return _hydra_main()


def preflight(overrides: Sequence[str]) -> None:
    """Find a mistake in the config or a missing dataset before anything heavy is imported."""
    if any(override.startswith("sweep=") and override != "sweep=null" for override in overrides):
        name = next(override for override in overrides if override.startswith("sweep="))
        raise UserError(f"{name} is a sweep of many runs", f"Run it with -m: python train.py -m {' '.join(overrides)}")
    raw = to_plain(compose(overrides))
    from sextant.cli.environment import check_environment

    check_environment(raw, checked(raw))


def run_config(config: DictConfig) -> dict[str, Any] | None:
    """What Hydra calls for every run: a single one ends the process, a cell of a sweep returns its outcome."""
    quiet_libraries()
    from sextant.cli.show import show_result
    from sextant.cli.terminal import TERMINAL
    from sextant.cli.workers import end_with_controller
    from sextant.lifecycle.execute import execute, execute_cell
    from sextant.runs.directory import RunDirectory

    raw = to_plain(config)
    if HydraConfig.get().mode == RunMode.MULTIRUN:
        end_with_controller()
        return execute_cell(raw, TERMINAL)
    with reporting_mistakes():
        outcome = execute(raw, reporter=TERMINAL)
        show_result(RunDirectory(outcome.directory), task=raw["task"]["name"], reused=outcome.reused)
    return None


def _hydra_main() -> None:
    hydra.main(config_path=str(conf_dir()), config_name="train", version_base="1.3")(run_config)()
