"""``train.py``: one run, or with ``-m`` a sweep."""

import sys
from collections.abc import Sequence

import hydra
from omegaconf import DictConfig

from sextant.composing.compose import compose, register_resolvers, run_help, shown, to_plain
from sextant.composing.config_files import folders, own_configs, without_folder
from sextant.composing.overrides import literal
from sextant.console.console import reporting_mistakes
from sextant.errors import UserError
from sextant.lifecycle.checks import checked, preflight
from sextant.runs.outputs_folder import conf_dir
from sextant.tracking.environment import quiet_libraries

MULTIRUN = ("-m", "--multirun")
DRY_RUN = "--dry-run"
#: Flags with which Hydra only prints something.
ONLY_PRINT = ("--help", "-h", "--hydra-help", "--version", "--cfg", "-c", "--info", "-i", "--shell-completion", "-sc")

#: those of them that print the config of a run, which must be valid
PRINT_CONFIG = ("--cfg", "-c")


def main(arguments: Sequence[str]) -> None:
    """Run all light checks, then hand over to Hydra."""
    quiet_libraries()
    register_resolvers()
    words, folder = without_folder(arguments)
    if any(word in MULTIRUN for word in words):
        _sweep(words, folder)
        return
    with own_configs(folder):
        if (text := _printed(words)) is not None:
            print(text)
            return
        _check(words)
        sys.argv = [sys.argv[0], *map(literal, words)]
        if folder is not None:
            sys.argv += ["--config-dir", str(folders()[-1])]
        hydra.main(config_path=str(conf_dir()), config_name="train", version_base="1.3")(run_config)()


def _sweep(words: Sequence[str], folder: str | None) -> None:
    """Run a sweep, which uses Hydra only to compose configs."""
    from sextant.cli.sweep import run_sweep, show_dry_run
    from sextant.lifecycle.sweep_plan import check_sweep_overrides, sweep_words

    flags = [word for word in words if word.startswith("-") and word not in (*MULTIRUN, DRY_RUN)]
    if flags:
        told = "prints something about one run; -m starts many" if flags[0].split("=")[0] in ONLY_PRINT else "unknown"
        raise UserError(f"{flags[0]} {told}", "Leave one of them out.")
    overrides = [word for word in words if not word.startswith("-")]
    with own_configs(folder):
        overrides = sweep_words(overrides)
        check_sweep_overrides(overrides)
        (show_dry_run if DRY_RUN in words else run_sweep)(overrides)


def _printed(words: Sequence[str]) -> str | None:
    """What the flags ``--help`` and ``--cfg job`` print; None for other flags, or none."""
    rest = [word for word in words if not is_override(word)]
    overrides = [word for word in words if is_override(word)]
    if rest in (["--help"], ["-h"]):
        return run_help(overrides)
    if rest in (["--cfg", "job"], ["-c", "job"], ["--cfg=job"]):
        config = compose(overrides)
        checked(to_plain(config))
        return shown(config).rstrip("\n")
    return None


def is_override(word: str) -> bool:
    """Whether a word of the command line sets or deletes a key, and is no flag."""
    return ("=" in word or "~" in word) and not word.startswith("-")


def _check(arguments: Sequence[str]) -> None:
    """Find mistakes in the arguments before anything heavy is imported."""
    if not any(argument.split("=")[0] in ONLY_PRINT for argument in arguments):
        from sextant.cli.terminal import TERMINAL

        preflight([argument for argument in arguments if not argument.startswith("-")], TERMINAL)
    elif any(argument.split("=")[0] in PRINT_CONFIG for argument in arguments):
        checked(to_plain(compose([word for word in arguments if is_override(word)])))


def run_config(config: DictConfig) -> None:
    """Run a composed config; called by Hydra."""
    from hydra.core.hydra_config import HydraConfig

    from sextant.cli.show import show_next, show_result
    from sextant.cli.terminal import TERMINAL
    from sextant.lifecycle.execute import execute

    with reporting_mistakes("train"):
        raw, typed = to_plain(config), HydraConfig.get().overrides.task
        outcome = execute(raw, reporter=TERMINAL)
        show_result(outcome, typed)
        show_next(checked(raw), outcome, typed)
