"""Running a sweep: only what is missing, with any launcher."""

import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from sextant.config import Config
from sextant.lifecycle.execute import Outcome, Status, fill_if_behind
from sextant.lifecycle.run_reporter import SILENT_RUN, RunReporter
from sextant.lifecycle.sweep_plan import Planned, make_plan
from sextant.lifecycle.workers import Launch, announce_controller
from sextant.runs.directory import RunDirectory
from sextant.runs.locks import run_lock
from sextant.runs.sweep_directory import Cell, SweepPlan, read_plan

POLL_S = 1.0


@dataclass(frozen=True)
class SweepOutcome:
    """How a sweep ended.

    Attributes:
        name: of the sweep.
        directory: with its plan, and its report once there is one.
        cells: what was planned.
        outcomes: how the run of each cell ended; arms that read different answers share runs.
    """

    name: str
    directory: Path
    cells: tuple[Cell, ...]
    outcomes: tuple[Outcome, ...]

    def count(self, status: Status) -> int:
        """How many cells ended so."""
        return sum(outcome.status == status for outcome in self.outcomes)


def run_sweep(arguments: Sequence[str], launch: Launch, reporter: RunReporter = SILENT_RUN) -> SweepOutcome:
    """Plan a sweep and run its missing cells; those that fail do not keep the others from running.

    Args:
        arguments: overrides; those that list several values are the factors of the sweep.
        launch: runs cells.
        reporter: listens.

    Raises:
        UserError: a cell's config is wrong; nothing was run then.
    """
    plan, planned, config = make_plan(arguments, reporter)
    outputs = Path(config.paths.outputs)
    with run_lock(outputs / "sweeps", plan.directory(outputs).name, wait=False):
        plan = _run_planned(plan, planned, config, outputs, launch, reporter)
    fill_if_behind(config, [RunDirectory(outputs / cell.run) for cell in plan.cells], reporter)
    before = {entry.cell.run for entry in planned if entry.finished}
    outcomes = [_outcome(cell, outputs, reused=cell.run in before) for cell in plan.cells]
    return SweepOutcome(plan.name, plan.directory(outputs), tuple(plan.cells), tuple(outcomes))


def _run_planned(
    plan: SweepPlan, planned: list[Planned], config: Config, outputs: Path, launch: Launch, reporter: RunReporter
) -> SweepPlan:
    if (plan.directory(outputs) / "cells.json").exists():  # begun before: it keeps its parent run
        before = read_plan(plan.directory(outputs))
        plan = replace(plan, mlflow_runs=before.mlflow_runs, began=before.began, ended=before.ended)
    plan.write(outputs)
    started: dict[str, Planned] = {}  # arms that read other answers of the same run share it
    for entry in planned:
        if not entry.finished:
            started.setdefault(entry.cell.run, entry)
    missing = list(started.values())
    reporter.planned(plan, len({cell.run for cell in plan.cells}) - len(missing))
    return _run_missing(plan, missing, config, outputs, launch, reporter) if missing else plan


def _run_missing(
    plan: SweepPlan, missing: list[Planned], config: Config, outputs: Path, launch: Launch, reporter: RunReporter
) -> SweepPlan:
    quiet = ["trainer.progress=false"]
    parent = None
    plan = replace(plan, began=plan.began or time.time(), ended=0.0)
    plan.write(outputs)
    if config.tracking.kind != "none":
        from sextant.tracking.refill import catch_up
        from sextant.tracking.sweep_parent import open_parent

        experiment = config.tracking.experiment or config.task.name
        parent = open_parent(config.tracking.kind, config.tracking.uri, outputs, plan, experiment)
        if parent.run_id not in plan.mlflow_runs:
            plan = replace(plan, mlflow_runs=[*plan.mlflow_runs, parent.run_id])
        plan.write(outputs)
        quiet.append(f"tracking.parent_run={parent.run_id}")
        catch_up(config.tracking.kind, config.tracking.uri, outputs, reporter)
    announce_controller()
    try:
        with _watched([RunDirectory(outputs / entry.cell.run) for entry in missing], reporter):
            outcomes = launch([[*entry.overrides, *quiet] for entry in missing])
    except BaseException as error:
        plan = _ended(plan, outputs)
        if parent is not None:
            killed = isinstance(error, KeyboardInterrupt | SystemExit)
            parent.status("KILLED" if killed else "FAILED", plan.ended)
        raise
    failed = {
        entry.cell.run: outcome["message"]
        for entry, outcome in zip(missing, outcomes, strict=True)
        if outcome["status"] == "failed"
    }
    plan = _ended(replace(plan, cells=[replace(c, message=failed.get(c.run, "")) for c in plan.cells]), outputs)
    if parent is not None:
        parent.status("FAILED" if failed else "FINISHED", plan.ended)
    return plan


def _ended(plan: SweepPlan, outputs: Path) -> SweepPlan:
    plan = replace(plan, ended=time.time())
    plan.write(outputs)
    return plan


@contextmanager
def _watched(missing: list[RunDirectory], reporter: RunReporter) -> Iterator[None]:
    """Report how many runs are done by looking at their directories: it works with every launcher."""
    done = threading.Event()

    def watch() -> None:
        with reporter.running() as advance:
            while True:
                advance(sum(run.metrics.is_file() for run in missing), len(missing))
                if done.wait(POLL_S):
                    return

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        done.set()
        watcher.join()


def _outcome(cell: Cell, outputs: Path, *, reused: bool) -> Outcome:
    run = RunDirectory(outputs / cell.run)
    results = run.results()
    return Outcome("failed" if results is None else results["outcome"], run.path, reused, cell.message)
