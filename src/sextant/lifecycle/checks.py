"""Checks that run before data is read or a run directory is made."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sextant.applications.arguments import check_apart
from sextant.composing.compose import compose, to_plain
from sextant.composing.config_files import sweep_command
from sextant.config import Config, validate
from sextant.config.building import naming_groups, require_callable
from sextant.errors import UserError
from sextant.kit.chapter import Source
from sextant.registry import chapter_of
from sextant.reporter import SILENT, Reporter
from sextant.tables import counted


def checked(raw: Mapping[str, Any]) -> Config:
    """Validate a config: its choices are compatible and every import path in it exists. The machine is not checked.

    Raises:
        UserError: as :func:`~sextant.config.validate.validate`; or choices are incompatible, or a module, name or
            callable does not exist.
    """
    config = validate(raw)
    chapter_of(config.task.name).check_parts(config)
    for key, path in config.custom_parts().items():
        require_callable(key, path)
    return config


def preflight(overrides: Sequence[str], reporter: Reporter = SILENT) -> dict[str, Any]:
    """Check that a run could be made here and return its plain config; nothing heavy is imported.

    Raises:
        UserError: an override is wrong; or as :func:`checked` and :func:`require_environment`.
    """
    if any(override.startswith("sweep=") and override != "sweep=null" for override in overrides):
        name = next(override for override in overrides if override.startswith("sweep="))
        raise UserError(f"{name} is a sweep of many runs", f"Run it with -m: {sweep_command(overrides)}")
    raw = to_plain(compose(overrides))
    config = checked(raw)
    if config.launcher.kind != "local":
        raise UserError(
            f"launcher={config.launcher.kind} runs sweeps",
            f"Add -m; a sweep may consist of one run: {sweep_command(overrides)}",
        )
    require_environment(config, reporter)
    return raw


def require_environment(config: Config, reporter: Reporter = SILENT) -> None:
    """Raise a ``UserError`` unless the data exist, outputs can be written, and the tracking store can be used."""
    from sextant.tracking.further_loggers import require_loggers
    from sextant.tracking.store import require_server, store_uri

    require_loggers(config.tracking.also)
    require_apart(config)
    require_outputs(Path(config.paths.outputs))
    if config.tracking.kind == "sqlite":
        store_uri(Path(config.paths.outputs))
    chapter = chapter_of(config.task.name, reporter)
    with naming_groups(config.plain):
        chapter.check(chapter.source(config))
    if config.tracking.kind == "server" and config.tracking.uri is not None:
        require_server(config.tracking.uri)


def require_apart(config: Config) -> None:
    """Raise a ``UserError`` if a run would write into a folder of images that its dataset reads."""
    dataset = config.plain["dataset"]
    for part in (dataset, *(dataset.get("sources") or {}).values()):
        folder = part.get("folder")
        if not isinstance(folder, str) or part["_target_"].endswith(".ImageFolder"):  # which does not read subfolders
            continue
        groups = [part.get(key) for key in ("train", "val", "test", "validation")]
        drives = {part.get("map")} | {name for each in groups if isinstance(each, Mapping) for name in each.values()}
        for root in (Path(), Path(config.paths.data)):
            whole = root / Path(folder).expanduser()
            inputs = [whole / name for name in drives if isinstance(name, str)] or [whole]
            for key in ("outputs", "cache"):
                for each in inputs:
                    check_apart(Path(config.plain["paths"][key]), key=f"paths.{key}", **{"dataset.folder": each})


def require_outputs(outputs: Path) -> None:
    """Create the output folder, and raise a ``UserError`` unless it is writable."""
    try:
        outputs.mkdir(parents=True, exist_ok=True)
        probe = outputs / f".writable-{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise UserError(
            f"paths.outputs={outputs} cannot be written to: {error.strerror}",
            "Choose another folder: paths.outputs=/path, or set SEXTANT_OUTPUTS",
        ) from None


def require_possible(config: Config, source: Source) -> None:
    """Raise a ``UserError`` unless this machine has the device and the data fill a training batch."""
    require_device(config)
    count = chapter_of(config.task.name).training_size(config, source)
    if count is not None and config.trainer.batch_size > count:
        raise UserError(
            f"trainer.batch_size={config.trainer.batch_size}: dataset={source.name} has {counted(count, 'image')} to "
            "train on",
            f"For example trainer.batch_size={min(32, count)}",
        )


def require_device(config: Config) -> None:
    """Raise a ``UserError`` if the config requires a GPU and there is none."""
    if config.trainer.accelerator == "gpu":
        import torch

        if not torch.cuda.is_available():
            raise UserError("trainer.accelerator=gpu: no CUDA device was found on this machine", "Use trainer=cpu")
