"""Running a sweep: only what is missing, with any launcher."""

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from sextant.cli.console import console
from sextant.cli.sweep_plan import Planned, make_plan
from sextant.cli.terminal import TERMINAL
from sextant.cli.workers import announce_controller
from sextant.config import Config
from sextant.lifecycle.execute import fill_if_behind
from sextant.runs.directory import RunDirectory
from sextant.runs.locks import run_lock
from sextant.runs.sweep_directory import SweepPlan, read_plan

Launch = Callable[[Sequence[Sequence[str]]], list[Any]]
POLL_S = 1.0


def run_sweep(arguments: Sequence[str], launch: Launch) -> None:
    """Plan a sweep, run its missing cells, and say how it went.

    Args:
        arguments: the overrides of the command line; those that list several values are its factors.
        launch: runs cells with Hydra's launcher and returns their outcomes.

    Raises:
        UserError: a cell's config is wrong; nothing was run then.
        SystemExit: status 1 if any cell failed; the others have run.
    """
    plan, planned, config = make_plan(arguments)
    outputs = Path(config.paths.outputs)
    with run_lock(outputs / "sweeps", plan.directory(outputs).name, wait=False):
        plan = _run_planned(plan, planned, config, outputs, launch)
    fill_if_behind(config, [RunDirectory(outputs / cell.run) for cell in plan.cells], TERMINAL)
    _conclude(plan, outputs)


def _run_planned(plan: SweepPlan, planned: list[Planned], config: Config, outputs: Path, launch: Launch) -> SweepPlan:
    if (plan.directory(outputs) / "cells.json").exists():  # begun before: it keeps its parent run
        before = read_plan(plan.directory(outputs))
        plan = replace(plan, mlflow_runs=before.mlflow_runs, began=before.began, ended=before.ended)
    plan.write(outputs)
    started: dict[str, Planned] = {}  # arms that read other answers of the same run share it
    for entry in planned:
        if not entry.finished:
            started.setdefault(entry.cell.run, entry)
    missing = list(started.values())
    runs = len({entry.cell.run for entry in planned})
    told = f"{len(planned)} runs planned" if runs == len(planned) else f"{len(planned)} cells of {runs} runs planned"
    console.print(f"[bold]{plan.name}[/]: {told}, {runs - len(missing)} finished already")
    return _run_missing(plan, missing, config, outputs, launch) if missing else plan


def _run_missing(plan: SweepPlan, missing: list[Planned], config: Config, outputs: Path, launch: Launch) -> SweepPlan:
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
        catch_up(config.tracking.kind, config.tracking.uri, outputs, TERMINAL)
    announce_controller()
    try:
        with _progress(missing, outputs):
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
        if outcome["outcome"] == "failed"
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
def _progress(missing: list[Planned], outputs: Path) -> Iterator[None]:
    """A bar over the missing cells, fed by looking at their directories: it works with every launcher."""
    columns = (TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    done = threading.Event()
    files = [RunDirectory(outputs / entry.cell.run).metrics for entry in missing]

    def watch() -> None:
        finished = 0
        with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
            task = bar.add_task("", total=len(files))
            while True:
                now = sum(file.is_file() for file in files)
                bar.update(task, completed=now)
                if now > finished and not console.is_terminal:
                    console.print(f"{now}/{len(files)} runs")
                finished = now
                if done.wait(POLL_S):
                    return

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        done.set()
        watcher.join()


def _conclude(plan: SweepPlan, outputs: Path) -> None:
    outcomes: Counter[str] = Counter()
    for cell in plan.cells:
        results = RunDirectory(outputs / cell.run).results()
        outcomes[results["outcome"] if results is not None else "failed"] += 1
    counts = ", ".join(f"{outcomes[name]} {name}" for name in ("finished", "diverged", "failed"))
    console.print(f"[bold]{plan.name}[/]: {len(plan.cells)} planned, {counts}")
    for cell in plan.cells:
        if cell.message:
            console.print(f"[red]failed[/] {cell.setting} {cell.arm} seed {cell.seed}: {escape(cell.message)}")
    console.print(f"report  python report.py sweep={plan.directory(outputs).name}")
    if outcomes["failed"]:
        raise SystemExit(1)
