"""What ``debug=`` changes in a training, and the replay of a step that was not finite."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import pytorch_lightning as pl
import torch
import yaml
from pytorch_lightning.callbacks import Callback
from pytorch_lightning.profilers import SimpleProfiler

from sextant.config import Config, validate
from sextant.config.building import naming_groups
from sextant.config.schema.training import Debug
from sextant.config.trained import trained_config
from sextant.errors import UserError
from sextant.lifecycle.checks import checked
from sextant.registry import chapter_of
from sextant.reporter import SILENT, Reporter
from sextant.runs.directory import RunDirectory
from sextant.runs.outputs_folder import default_outputs
from sextant.training.not_finite import Finding, ModuleCall, WatchFinite, keep_step, read_step


class Repeated:
    """The first batches of a loader, again in every epoch.

    Args:
        load: makes the loader.
        count: number of batches.
    """

    def __init__(self, load: Callable[[], Iterable[Any]], count: int):
        self.load, self.count = load, count
        self._kept: list[Any] | None = None

    def _batches(self) -> list[Any]:
        if self._kept is None:
            self._kept = list(islice(self.load(), self.count))
        return self._kept

    def __len__(self) -> int:
        return len(self._batches())

    def __iter__(self) -> Iterator[Any]:
        return iter(self._batches())


class LossOfRepeated(Callback):
    """Tells the loss of the first and the last epoch on the repeated batches."""

    def __init__(self, say: Callable[[str], None]):
        self.say, self.epochs = say, dict[int, list[float]]()

    def on_train_batch_end(self, trainer: pl.Trainer, pl_module: Any, outputs: Any, *args: Any) -> None:
        """Note the loss."""
        loss = outputs.get("loss") if isinstance(outputs, Mapping) else outputs
        if loss is not None:
            self.epochs.setdefault(trainer.current_epoch + 1, []).append(float(loss))

    def on_train_end(self, trainer: pl.Trainer, pl_module: Any) -> None:
        """Tell both, of the epochs since the run was resumed; nothing if the module returns no loss."""
        if self.epochs:
            first, last = min(self.epochs), max(self.epochs)
            told = [f"{sum(self.epochs[each]) / len(self.epochs[each]):.4g} in epoch {each}" for each in (first, last)]
            self.say(f"debug=overfit: loss on {len(self.epochs[first])} batches {', '.join(told)}")


def trainer_settings(debug: Debug | None, directory: RunDirectory) -> dict[str, Any]:
    """Settings of a Lightning trainer."""
    if debug is None:
        return {}
    limits = dict.fromkeys(("limit_train_batches", "limit_val_batches", "limit_test_batches"), debug.batches)
    if debug.overfit is not None:
        limits = dict.fromkeys(("limit_val_batches", "limit_test_batches"), debug.overfit)
    profiler = {"profiler": SimpleProfiler(directory.path, "profile")} if debug.profile else {}
    return {name: count for name, count in limits.items() if count is not None} | profiler


def debugging(
    config: Config, data: pl.LightningDataModule, directory: RunDirectory, reporter: Reporter
) -> list[Callback]:
    """The callbacks of a training; with ``overfit`` the data give the same batches in every epoch."""
    if (debug := config.debug) is None:
        return []
    command = f"sextant replay run={directory.path}" + (" trust=true" if config.custom_targets() else "")
    found: list[Callback] = [WatchFinite(keep_step(directory.path, command))] if debug.nan else []
    if debug.overfit is not None:
        repeated = Repeated(data.train_dataloader, debug.overfit)
        data.train_dataloader = lambda: repeated  # type: ignore[method-assign]
        found.append(LossOfRepeated(reporter.say))
    return found


@dataclass(frozen=True)
class Replayed:
    """A step that was computed again.

    Attributes:
        kept: what training found.
        found: what the replay found; None if all was finite.
        calls: the calls of modules until then, in order.
    """

    kept: Finding
    found: Finding | None
    calls: list[ModuleCall]


class _FoundAgainError(Exception):
    pass


def replay(run: Path, reporter: Reporter = SILENT, *, outputs: Path | None = None, trust: bool = False) -> Replayed:
    """Compute the step again that ``debug=nan`` kept in the directory of a run.

    Args:
        run: the directory.
        reporter: listens to what is built.
        outputs: folder of runs, in which other runs that the config names are looked up; None for the default.
        trust: allow parts from outside Sextant.

    Raises:
        UserError: the run has none, or its files are damaged, or its config names parts from outside Sextant, which
            would run code chosen by the file.
    """
    directory = RunDirectory(run)
    kept, step = read_step(run)
    config = _own_config(directory, outputs or default_outputs(), trust=trust)
    found: list[Finding] = []

    def again(finding: Finding, *_: Any) -> None:
        found.append(finding)
        raise _FoundAgainError

    calls: list[ModuleCall] = []
    watch = WatchFinite(again, step["random"], calls)
    trainer = pl.Trainer(
        accelerator="cpu", max_epochs=1, limit_train_batches=1, limit_val_batches=0, logger=False, callbacks=[watch],
        enable_checkpointing=False, enable_progress_bar=False, enable_model_summary=False, num_sanity_val_steps=0,
        deterministic=config.trainer.deterministic, use_distributed_sampler=False, default_root_dir=run,
    )  # fmt: skip
    with suppress(_FoundAgainError):
        _fit_one(config, trainer, step, reporter)
    return Replayed(kept, found[0] if found else None, calls)


def _own_config(directory: RunDirectory, outputs: Path, *, trust: bool) -> Config:
    """The config of a run, after the check for parts from outside Sextant.

    Other runs in ``outputs`` are the user's own and may name any part, so the config does not choose that folder.
    """
    try:
        raw = yaml.safe_load(directory.config.read_text())
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise UserError(f"{directory.config} cannot be read: {error}", "Train again with debug=nan.") from None
    if not isinstance(raw, dict):
        raise UserError(f"{directory.config} holds no config", "Train again with debug=nan.")
    trained_config(raw, validate(raw).task.name, trust=trust, what=f"the run in {directory.path}")
    if not trust:
        raw["paths"] = {**raw["paths"], "outputs": str(outputs)}
    return checked(raw)


def _fit_one(config: Config, trainer: pl.Trainer, step: dict[str, Any], reporter: Reporter) -> None:
    chapter = chapter_of(config.task.name, reporter)
    torch.set_num_threads(config.trainer.threads)
    with naming_groups(config.plain):
        source = chapter.source(config)
        data = chapter.data(config, source)
        module = chapter.module(config, chapter.spec(config, source, data), training=True)
    module.load_state_dict(step["weights"])
    once = Repeated(lambda: [step["batch"]], 1)
    data.train_dataloader = lambda: once
    trainer.fit(module, data)


def find_run(reference: str, outputs: Path) -> Path:
    """The directory of a run, by its path or its name.

    Raises:
        UserError: there is no such run.
    """
    path = Path(reference).expanduser()
    for each in (path, outputs / "runs" / path, *outputs.glob(f"runs/*/{reference}")):
        if RunDirectory(each).config.is_file():
            return each.absolute()
    raise UserError(f"run={reference}: there is no run directory of that name", "Give its path, as training told it.")
