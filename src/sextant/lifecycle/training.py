"""Fit, validate and test with Lightning; imported by the life cycle once all light checks have passed."""

import platform
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytorch_lightning as pl
import torch
from lightning_fabric.plugins.environments.lightning import LightningEnvironment
from pytorch_lightning.callbacks import Callback, EarlyStopping, ModelCheckpoint
from pytorch_lightning.loggers import Logger

from sextant.atomic_files import write_atomically, write_json
from sextant.config import Config
from sextant.config.building import naming_groups
from sextant.config.schema.training import Trainer
from sextant.figures.style import save_figure, titled
from sextant.kit.chapter import Chapter, Source
from sextant.kit.trained import load_weights, model_from_checkpoint, read_trained
from sextant.layers.global_batch_norm import global_batch_norm
from sextant.lifecycle.debugging import debugging, trainer_settings
from sextant.lifecycle.published_figures import same_images
from sextant.lifecycle.ranks import Processes, Rank, ranks
from sextant.lifecycle.run_reporter import SILENT_RUN, RunReporter
from sextant.registry import chapter_of
from sextant.runs.checkpoint import KEY, SCHEMA_VERSION, load_checkpoint
from sextant.runs.checkpoint_io import AtomicCheckpointIO
from sextant.runs.directory import RunDirectory, RunKey
from sextant.runs.resolve import resolve_run
from sextant.tracking.further_loggers import closing, further_loggers
from sextant.tracking.logger import RunLogger, system_metrics
from sextant.tracking.mirror import MirroredRun
from sextant.training.peak_memory import reset_peak_memory

#: PyTorch's names for x86 processors that only emulate bfloat16, at a tenth of the speed of float32 or less
WITHOUT_BFLOAT16 = ("NO AVX", "DEFAULT", "AVX2")


def train_and_test(
    config: Config,
    source: Source,
    directory: RunDirectory,
    key: RunKey,
    mirror: MirroredRun | None,
    reporter: RunReporter,
) -> dict[str, Any]:
    """Train from the last checkpoint or from scratch, test, and write the results, ``metrics.json`` last.

    Returns:
        The content of ``metrics.json``.
    """
    began = time.monotonic()
    reset_peak_memory()
    _tell_precision(config.trainer, reporter)
    chapter = chapter_of(config.task.name, reporter)
    loggers = [RunLogger(directory, mirror), *further_loggers(config.tracking.also, directory)]
    resume = directory.last_checkpoint.is_file()
    clock = _Clock(directory, began, resumed=resume)
    shown = reporter.training() if config.trainer.progress else []
    monitor = mirror if config.tracking.system_metrics else None
    measured = system_metrics(monitor, config.tracking.system_metrics_every_s)
    with closing(loggers), measured, naming_groups(config.plain):
        with ranks(config, directory, key, resume=resume) as rank:
            fitted = fit(
                config, chapter, source, directory, key,
                resume=resume, rank=rank, logger=loggers, clock=clock, shown=shown, reporter=reporter,
            )  # fmt: skip
        trained, fit_s = time.monotonic(), clock.seconds()
        results = _test(fitted, config, directory, chapter, loggers)
    return _write_results(results, directory, key, fit_s=fit_s, test_s=time.monotonic() - trained)


@dataclass(frozen=True)
class Fitted:
    """The objects that training leaves in memory."""

    trainer: pl.Trainer
    module: Any
    data: pl.LightningDataModule


def fit(
    config: Config,
    chapter: Chapter[Any],
    source: Source,
    directory: RunDirectory,
    key: RunKey,
    *,
    resume: bool,
    rank: Rank | None = None,
    logger: Sequence[Logger] = (),
    clock: Callback | None = None,
    shown: Sequence[Callback] = (),
    reporter: RunReporter = SILENT_RUN,
) -> Fitted:
    """Train from the last checkpoint or from scratch.

    Args:
        config: config of the run.
        chapter: chapter of its task.
        source: source of its data.
        directory: run directory with its checkpoints.
        key: key of the run.
        resume: whether to resume from the last checkpoint.
        rank: rank of this process among several; None if it is the only one.
        logger, clock, shown: loggers and callbacks of the process that writes; the others have none.
        reporter: listens to the training.
    """
    torch.set_num_threads(config.trainer.threads)
    pl.seed_everything(config.seed, verbose=False)
    data = chapter.data(config, source)
    spec = chapter.spec(config, source, data)
    module = chapter.module(config, spec, training=True)
    if config.init_from is not None:
        checkpoint = resolve_run(config.init_from, Path(config.paths.outputs), "init_from").checkpoint
        load_weights(module, read_trained(checkpoint), checkpoint)
    callbacks: list[Callback] = [_EpochSeed(config.seed), _Provenance(config, spec, key), *([clock] if clock else [])]
    if config.trainer.patience is not None:
        callbacks.append(_Patience(module.monitor, mode=module.monitor_mode, patience=config.trainer.patience))
    if config.task.test_checkpoint == "best":  # first, so that the last checkpoint includes its own epoch's best
        callbacks.append(_best_epoch(directory, module.monitor, module.monitor_mode))
    callbacks += [_every_epoch(directory), *shown, *debugging(config, data, directory, reporter)]
    trainer = _trainer(config, directory, logger, callbacks, rank)
    with _prepared(module, compiled=config.trainer.compile, shared=rank is not None), unfilled_tensors():
        trainer.fit(module, data, ckpt_path=directory.last_checkpoint if resume else None, weights_only=True)
    if trainer.interrupted:
        raise KeyboardInterrupt
    return Fitted(trainer, module, data)


@contextmanager
def unfilled_tensors() -> Iterator[None]:
    """Leave new tensors as they are in deterministic mode, which otherwise fills each with nan.

    The filling takes time (some tenth of a step of EfficientNet-Lite0) and changes no result of a network that reads
    nothing before it is written.
    """
    settings: Any = torch.utils.deterministic
    before = settings.fill_uninitialized_memory
    settings.fill_uninitialized_memory = False
    try:
        yield
    finally:
        settings.fill_uninitialized_memory = before


@contextmanager
def _prepared(module: Any, *, compiled: bool, shared: bool) -> Iterator[None]:
    """Prepare the network for training: compile it, or normalise batches over all processes."""
    if compiled:
        module.network.compile()
    with global_batch_norm(module) if shared else nullcontext():
        yield
    if compiled:  # a test inspects the network's layers, and runs it only once under each condition
        module.network._compiled_call_impl = None


def test_checkpoint(
    config: Config,
    source: Source,
    content: Mapping[str, Any],
    checkpoint: Path,
    directory: RunDirectory,
    key: RunKey,
    reporter: RunReporter,
) -> dict[str, Any]:
    """Test a checkpoint's model under the conditions of ``config``, and write results as a training run does."""
    began = time.monotonic()
    reset_peak_memory()
    _tell_precision(config.trainer, reporter)
    torch.set_num_threads(config.trainer.threads)
    module = model_from_checkpoint(config, content, checkpoint)
    chapter = chapter_of(config.task.name, reporter)
    data = chapter.data(config, source)
    loggers = [RunLogger(directory, None), *further_loggers(config.tracking.also, directory)]
    trainer = _trainer(config, directory, loggers, [], None)
    with closing(loggers), naming_groups(config.plain):
        metrics = dict(trainer.test(module, data, verbose=False)[0])
        results: dict[str, Any] = {"outcome": "finished", "metrics": metrics}
        if (published := content[KEY].get("published")) is not None:
            facts = {"same_images": same_images(config), "precision": config.trainer.precision}
            results["published"] = published | facts
        if (foreign := content[KEY].get("foreign")) is not None:
            results["foreign"] = foreign
        results = _with_record(results, module, data, config, directory, chapter)
    return _write_results(results, directory, key, fit_s=0.0, test_s=time.monotonic() - began)


def _write_results(
    results: dict[str, Any], directory: RunDirectory, key: RunKey, *, fit_s: float, test_s: float
) -> dict[str, Any]:
    results = results | key.identity | {"timing": {"fit_s": fit_s, "test_s": test_s}}
    write_json(directory.metrics, results)
    return results


def _effective_precision(settings: Trainer) -> Literal["32-true", "16-mixed", "bf16-mixed"]:
    """The precision in use: float32 where bfloat16 is requested on a processor that would only emulate it."""
    emulated = (
        (settings.accelerator, settings.precision) == ("cpu", "bf16-mixed")
        and platform.machine() == "x86_64"
        and torch.backends.cpu.get_cpu_capability() in WITHOUT_BFLOAT16
    )
    return "32-true" if emulated else settings.precision


def _tell_precision(settings: Trainer, reporter: RunReporter) -> None:
    if _effective_precision(settings) != settings.precision:
        reporter.say(
            f"trainer.precision={settings.precision}: this processor has no bfloat16 and would only emulate it, "
            "many times slower than float32; float32 is used instead"
        )


def _trainer(
    config: Config, directory: RunDirectory, logger: Sequence[Logger], callbacks: list[Callback], rank: Rank | None
) -> pl.Trainer:
    return pl.Trainer(
        accelerator=config.trainer.accelerator,
        devices=1 if rank is None else config.trainer.devices,
        strategy="auto" if rank is None else Processes(),
        precision=_effective_precision(config.trainer),
        deterministic=config.trainer.deterministic,
        max_epochs=config.trainer.max_epochs,
        accumulate_grad_batches=config.trainer.accumulate,
        logger=list(logger) or False,
        callbacks=callbacks,
        enable_checkpointing=bool(callbacks),
        # without an explicit environment Lightning would requeue SLURM jobs itself
        plugins=[AtomicCheckpointIO(), rank or LightningEnvironment()],
        default_root_dir=directory.path,
        log_every_n_steps=config.trainer.log_every,
        num_sanity_val_steps=0,
        use_distributed_sampler=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        **trainer_settings(config.debug, directory),
    )


def _every_epoch(directory: RunDirectory) -> ModelCheckpoint:
    return ModelCheckpoint(
        directory.checkpoints, filename="last", save_on_train_epoch_end=True, enable_version_counter=False
    )


def _best_epoch(directory: RunDirectory, monitor: str, mode: str) -> ModelCheckpoint:
    return ModelCheckpoint(
        directory.checkpoints,
        filename="best",
        monitor=monitor,
        mode=mode,
        save_on_train_epoch_end=True,
        enable_version_counter=False,
    )


def _test(
    fitted: Fitted, config: Config, directory: RunDirectory, chapter: Chapter[Any], logger: Sequence[Logger]
) -> dict[str, Any]:
    """Validate and test the selected weights in this process, and write arrays and figures."""
    trainer, module, data = fitted.trainer, fitted.module, fitted.data
    epochs, steps = trainer.current_epoch, trainer.global_step
    if config.trainer.devices > 1:
        trainer = _trainer(config, directory, logger, [], None)
        trainer.fit_loop.load_state_dict(fitted.trainer.fit_loop.state_dict())  # metrics are logged at this step
    if config.task.test_checkpoint == "best":
        module.load_state_dict(load_checkpoint(directory.best_checkpoint)["state_dict"])
    validation = dict(trainer.validate(module, data, verbose=False)[0])
    results = {
        "outcome": "finished" if config.debug is not None or module.converged(validation) else "diverged",
        "metrics": validation | dict(trainer.test(module, data, verbose=False)[0]),
        "test_checkpoint": config.task.test_checkpoint,
        "epochs": epochs,
        "steps": steps,
    }
    return _with_record(results, module, data, config, directory, chapter)


def _with_record(
    results: dict[str, Any],
    module: Any,
    data: pl.LightningDataModule,
    config: Config,
    directory: RunDirectory,
    chapter: Chapter[Any],
) -> dict[str, Any]:
    """Write per-image results and figures of the last test, and return ``results`` with its further findings."""
    record = chapter.record(module, data, config)
    write_atomically(directory.arrays, lambda file: np.savez_compressed(file, **record.arrays))  # type: ignore[arg-type]
    for name, figure in record.figures:
        save_figure(titled(figure, name.replace("_", " ")), directory.figures, name)
    for name, write in record.files.items():
        write(directory.path / name)
    parameters = sum(parameter.numel() for parameter in module.parameters())
    table = {"table": record.table} if record.table else {}
    facts = {"parameters": parameters, "precision": _effective_precision(config.trainer)} | table | record.facts
    return results | {"metrics": results["metrics"] | record.metrics} | facts


class _EpochSeed(Callback):
    """Seeds torch from (seed, epoch) at the start of every epoch, so that a resumed epoch draws the same numbers."""

    def __init__(self, seed: int):
        self.seed = seed

    def on_train_epoch_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        torch.manual_seed(self.seed * 1_000_003 + trainer.current_epoch)


class _Patience(EarlyStopping):
    """Stops training after ``patience`` epochs without a better validation metric, also if resumed after that point."""

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        trainer.should_stop = self.wait_count >= self.patience


class _Clock(Callback):
    """Training time in seconds, summed over the parts of a resumed run and recorded beside every epoch's checkpoint.

    It is not stored in the checkpoint, whose hash identifies the trained model. Work after the last complete epoch of a
    part is repeated by the next part and counts once.
    """

    def __init__(self, directory: RunDirectory, began: float, *, resumed: bool):
        self._directory, self._began = directory, began
        self._before = float(directory.state().get("trained_s") or 0.0) if resumed else 0.0

    def seconds(self) -> float:
        """Training time until now."""
        return self._before + time.monotonic() - self._began

    def on_train_epoch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        self._directory.update_state({"trained_s": self.seconds()})


class _Provenance(Callback):
    """Stores the whole config in every checkpoint, as plain containers."""

    def __init__(self, config: Config, spec: Mapping[str, Any], key: RunKey):
        self.content = {
            "schema_version": SCHEMA_VERSION,
            "config": dict(config.plain),
            "spec": dict(spec),
            "task": key.task,
            **key.identity,
        }

    def on_save_checkpoint(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        checkpoint[KEY] = self.content

    def on_load_checkpoint(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Update the paths of the best checkpoint after the run directory was moved; Lightning would discard it."""
        for callback in trainer.checkpoint_callbacks:
            state = checkpoint["callbacks"].get(callback.state_key, {})
            before, here = str(state.get("dirpath")), str(callback.dirpath)  # type: ignore[attr-defined]
            for name in ("dirpath", "best_model_path", "last_model_path", "kth_best_model_path"):
                state[name] = str(state.get(name, "")).replace(before, here)
            scores = state.get("best_k_models", {})
            state["best_k_models"] = {path.replace(before, here): score for path, score in scores.items()}
