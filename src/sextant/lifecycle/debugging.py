"""What ``debug=`` changes in a training, and the replay of a step that was not finite."""

from collections.abc import Callable, Iterable, Iterator
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

from sextant.config import Config
from sextant.config.building import naming_groups
from sextant.config.schema.training import Debug
from sextant.errors import UserError
from sextant.lifecycle.checks import checked
from sextant.registry import chapter_of
from sextant.reporter import SILENT, Reporter
from sextant.runs.directory import RunDirectory
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
        self.say, self.epochs = say, list[list[float]]()

    def on_train_epoch_start(self, *args: Any) -> None:
        """Begin a list."""
        self.epochs.append([])

    def on_train_batch_end(self, trainer: pl.Trainer, pl_module: Any, outputs: Any, *args: Any) -> None:
        """Note the loss."""
        if outputs is not None:
            self.epochs[-1].append(float(outputs["loss"]))

    def on_train_end(self, trainer: pl.Trainer, pl_module: Any) -> None:
        """Tell both."""
        first, last = (sum(each) / max(1, len(each)) for each in (self.epochs[0], self.epochs[-1]))
        batches = len(self.epochs[0])
        epochs = len(self.epochs)
        self.say(f"debug=overfit: loss on {batches} batches {first:.4g} in epoch 1, {last:.4g} in epoch {epochs}")


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
    debug: Debug | None, data: pl.LightningDataModule, directory: RunDirectory, reporter: Reporter
) -> list[Callback]:
    """The callbacks of a training; with ``overfit`` the data give the same batches in every epoch."""
    if debug is None:
        return []
    found: list[Callback] = [WatchFinite(keep_step(directory.path))] if debug.nan else []
    if debug.overfit is not None:
        data.train_dataloader = _Constant(Repeated(data.train_dataloader, debug.overfit))  # type: ignore[method-assign]
        found.append(LossOfRepeated(reporter.say))
    return found


class _Constant:
    """A function that always returns the same loader."""

    def __init__(self, loader: Any):
        self.loader = loader

    def __call__(self) -> Any:
        return self.loader


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


def replay(run: Path, reporter: Reporter = SILENT) -> Replayed:
    """Compute the step again that ``debug=nan`` kept in the directory of a run.

    Raises:
        UserError: the run has none, or its files are damaged, or its config names parts from outside Sextant that
            cannot be imported.
    """
    directory = RunDirectory(run)
    kept, step = read_step(run)
    raw = yaml.safe_load(directory.config.read_text())
    config = checked(raw)
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


def _fit_one(config: Config, trainer: pl.Trainer, step: dict[str, Any], reporter: Reporter) -> None:
    chapter = chapter_of(config.task.name, reporter)
    torch.set_num_threads(config.trainer.threads)
    with naming_groups(config.plain):
        source = chapter.source(config)
        data = chapter.data(config, source)
        module = chapter.module(config, chapter.spec(config, source, data), training=True)
    module.load_state_dict(step["weights"])
    data.train_dataloader = _Constant(Repeated(lambda: [step["batch"]], 1))
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
