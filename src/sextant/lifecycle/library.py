"""The life cycle as calls of a library: ``sextant.run``, ``sextant.sweep``, ``sextant.evaluate``."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from sextant.composing.config_files import own_configs
from sextant.errors import ArgumentError, naming_extras
from sextant.lifecycle.checks import preflight
from sextant.lifecycle.evaluation import evaluate_run
from sextant.lifecycle.execute import Outcome, execute
from sextant.lifecycle.run_reporter import SILENT_RUN, RunReporter
from sextant.lifecycle.search.run import sweep_or_search
from sextant.lifecycle.sweep import SweepOutcome
from sextant.lifecycle.sweep_plan import check_sweep_overrides, sweep_words
from sextant.tracking.environment import quiet_libraries


@contextmanager
def _warnings_as_before() -> Iterator[None]:
    with warnings.catch_warnings():
        yield


@contextmanager
def _process_as_before() -> Iterator[None]:
    """Restore at the end what a run sets in its process: threads, deterministic mode and random states."""
    import os
    import random

    import numpy as np
    import torch

    seeds = {name: os.environ.get(name) for name in ("PL_GLOBAL_SEED", "PL_SEED_WORKERS")}
    threads, debug_mode = torch.get_num_threads(), torch.get_deterministic_debug_mode()
    benchmark, python, arrays = torch.backends.cudnn.benchmark, random.getstate(), np.random.get_state()
    devices = range(torch.cuda.device_count()) if torch.cuda.is_initialized() else ()
    with torch.random.fork_rng(devices):
        try:
            yield
        finally:
            torch.set_num_threads(threads)
            if torch.get_deterministic_debug_mode() != debug_mode:
                torch.use_deterministic_algorithms(debug_mode > 0, warn_only=debug_mode == 1)
            torch.backends.cudnn.benchmark = benchmark
            random.setstate(python)
            np.random.set_state(arrays)
            for name, value in seeds.items():
                os.environ.pop(name, None)
                if value is not None:
                    os.environ[name] = value


def _checked(call: str, overrides: Sequence[str]) -> Sequence[str]:
    """The overrides of a call; an ``ArgumentError`` if they are one text, or no texts."""
    if not isinstance(overrides, list | tuple) or not all(isinstance(each, str) for each in overrides):
        pairs = [f"{key}={value}" for key, value in overrides.items()] if isinstance(overrides, Mapping) else None
        meant = [overrides] if isinstance(overrides, str) else pairs or ["trainer=fast"]
        raise ArgumentError(
            f"overrides={overrides!r} must be a list of texts, each key=value", f"For example {call}({meant!r})"
        )
    return overrides


@naming_extras("sextant.run")
@_warnings_as_before()
def run(
    overrides: Sequence[str] = (), *, config_dir: str | Path | None = None, reporter: RunReporter = SILENT_RUN
) -> Outcome:
    """Train and test the run that overrides describe, as ``train.py`` does, unless it is already finished.

    Args:
        overrides: overrides of the config: groups such as ``dataset=mnist``, values such as ``optimizer.lr=0.05``.
        config_dir: folder of the user's own config files, ``<group>/<option>.yaml``, beside the shipped ones.
        reporter: listens to the run; silent by default.

    Raises:
        UserError: an override or the data are wrong, or the loss became nan.

    Example:
        >>> import sextant
        >>> outcome = sextant.run(["inhibition=push_pull", "trainer=fast"])  # doctest: +SKIP
        >>> outcome.status, outcome.metrics["test/accuracy/clean"]  # doctest: +SKIP
    """
    quiet_libraries()
    with own_configs(config_dir):
        raw = preflight(_checked("sextant.run", overrides), reporter)
    with _process_as_before():
        return execute(raw, reporter=reporter)


@naming_extras("sextant.sweep")
@_warnings_as_before()
def sweep(
    name: str | None = None,
    overrides: Sequence[str] = (),
    *,
    workers: int = 1,
    config_dir: str | Path | None = None,
    reporter: RunReporter = SILENT_RUN,
) -> SweepOutcome:
    """Run the missing runs of a sweep, as ``train.py -m`` does; a failed run is an outcome, and the others go on.

    Args:
        name: name of a stored sweep. Without one, the sweep varies every override that lists several values, and
            compares the values of the last of these (apart from the seed).
        overrides: overrides of the config, such as ``sweep.seeds=3`` or ``inhibition=none,push_pull``.
        workers: number of processes on this machine; 1 runs the cells one after another in this process, unless a
            launcher is chosen in ``overrides``, such as ``launcher=slurm``.
        config_dir: as for :func:`run`.
        reporter: listens to the sweep, not to its runs.

    Raises:
        UserError: a cell's config is wrong, or the launcher has no ``workers``; nothing has been run then.

    Example:
        >>> import sextant
        >>> found = sextant.sweep("demo", ["sweep.seeds=3"], workers=2)  # doctest: +SKIP
        >>> found.count("finished"), found.directory  # doctest: +SKIP
    """
    quiet_libraries()
    arguments = [*([] if name is None else [f"sweep={name}"]), *_checked("sextant.sweep", overrides)]
    if not any(override.startswith("launcher=") for override in overrides):
        arguments.append("launcher=local" if workers == 1 else "launcher=joblib")
    if workers != 1:
        arguments.append(f"launcher.workers={workers}")
    with own_configs(config_dir):
        arguments = sweep_words(arguments)
        check_sweep_overrides(arguments)
        with _process_as_before():
            return sweep_or_search(arguments, reporter)


@naming_extras("sextant.evaluate")
@_warnings_as_before()
def evaluate(run: str | Path, overrides: Sequence[str] = (), *, reporter: RunReporter = SILENT_RUN) -> Outcome:
    """Test a trained run on other data or under other conditions, as ``evaluate.py`` does.

    Args:
        run: an MLflow run id, a run directory, a checkpoint or a published ``.pth.tar``.
        overrides: overrides such as ``corruption=gaussian``; ``sextant evaluate --help`` lists what may change.
        reporter: listens to the test.

    Raises:
        UserError: the run does not exist, an override is wrong, or the model does not fit the data.
    """
    quiet_libraries()
    given = _checked("sextant.evaluate", overrides)
    with _process_as_before():
        return evaluate_run(str(run), given, reporter)
