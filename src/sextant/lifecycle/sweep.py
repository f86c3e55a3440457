"""Running the missing runs of a sweep with any launcher."""

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.config import Config
from sextant.config.schema.launchers import SlurmLauncher
from sextant.errors import UserError
from sextant.lifecycle.execute import Outcome, Status, fill_if_behind
from sextant.lifecycle.launchers import launch, require_launcher
from sextant.lifecycle.launchers.cells import Cells, CellTask, Outcomes
from sextant.lifecycle.run_reporter import SILENT_RUN, RunReporter
from sextant.lifecycle.search.design import read_search
from sextant.lifecycle.sweep_plan import Planned, make_plan
from sextant.runs.directory import RunDirectory
from sextant.runs.locks import run_lock
from sextant.runs.sweep_directory import Cell, SweepPlan

if TYPE_CHECKING:
    from sextant.lifecycle.parent_page import ParentPage

POLL_S = 1.0
#: runs cells and returns the outcome of each, None for one that was left to a cluster
Launch = Callable[[Cells], Outcomes]


@dataclass(frozen=True)
class SweepOutcome:
    """How a sweep ended.

    Attributes:
        name: name of the sweep.
        directory: directory with its plan, and with its report once it is written.
        cells: the planned cells, of the block that was run if there is one.
        outcomes: outcome of the run of each cell; arms that read different methods share runs.
    """

    name: str
    directory: Path
    cells: tuple[Cell, ...]
    outcomes: tuple[Outcome, ...]

    def count(self, status: Status) -> int:
        """The number of cells that ended with this status."""
        return sum(outcome.status == status for outcome in self.outcomes)


def run_sweep(
    arguments: Sequence[str],
    reporter: RunReporter = SILENT_RUN,
    *,
    runs: RunReporter = SILENT_RUN,
    wait: bool | None = None,
    run_cells: Launch | None = None,
) -> SweepOutcome:
    """Plan a sweep and run its missing cells; a failed cell does not stop the others.

    Args:
        arguments: overrides; those that list several values are the factors of the sweep.
        reporter: listens to the sweep.
        runs: listens to its runs, in the processes that compute them.
        wait: whether to wait for jobs submitted to a cluster; None follows ``launcher.wait``.
        run_cells: runs cells instead of the config's launcher.

    Raises:
        UserError: a cell's config is wrong, or the launcher cannot be used; nothing has been run then.
    """
    plan, planned, config = make_plan(arguments, reporter)
    if wait is not None and isinstance(config.launcher, SlurmLauncher):
        config = config.model_copy(update={"launcher": config.launcher.model_copy(update={"wait": wait})})
    require_launcher(config)
    outputs = Path(config.paths.outputs).absolute()
    directory = plan.directory(outputs)

    def launched(cells: Cells) -> Outcomes:
        return launch(cells, config, directory, reporter, runs)

    with run_lock(outputs / "sweeps", directory.name, wait=False, lease_s=config.launcher.lease_s):
        plan, left = _run_planned(plan, planned, config, outputs, run_cells or launched, reporter)
    fill_if_behind(config, [RunDirectory(outputs / cell.run) for cell in plan.cells], reporter)
    before = {entry.cell.run for entry in planned if entry.finished}
    chosen = {entry.cell.run for entry in planned}
    cells = [cell for cell in plan.cells if cell.run in chosen]
    outcomes = [cell_outcome(cell, outputs, reused=cell.run in before, left=cell.run in left) for cell in cells]
    return SweepOutcome(plan.name, directory, tuple(cells), tuple(outcomes))


def dry_run(arguments: Sequence[str], reporter: RunReporter = SILENT_RUN) -> tuple[list[CellTask], str]:
    """The cells that :func:`run_sweep` would run, and its sbatch script under SLURM; nothing is run or written.

    Raises:
        UserError: as :func:`run_sweep`; or the overrides describe a search.
    """
    if read_search(arguments) is not None:
        raise UserError("--dry-run: the runs of a search depend on its earlier results", "Leave it out.")
    plan, planned, config = make_plan(arguments, reporter)
    require_launcher(config)
    outputs = Path(config.paths.outputs).absolute()
    cells = missing_cells(planned, outputs)
    if not (cells and isinstance(config.launcher, SlurmLauncher)):
        return cells, ""
    from sextant.lifecycle.launchers.slurm import script

    return cells, script(cells, config.launcher, plan.directory(outputs))


def missing_cells(planned: Sequence[Planned], outputs: Path) -> list[CellTask]:
    """The missing runs, each listed once: arms that read different methods of the same run share it."""
    missing = {entry.cell.run: entry for entry in planned if not entry.finished}
    return [CellTask(tuple(entry.overrides), outputs / run) for run, entry in missing.items()]


def _run_planned(
    plan: SweepPlan, planned: list[Planned], config: Config, outputs: Path, run_cells: Launch, reporter: RunReporter
) -> tuple[SweepPlan, set[str]]:
    """Run the missing cells; return the plan at the end, and the runs that were left to a cluster."""
    plan = plan.resumed(outputs)
    plan.write(outputs)
    missing = missing_cells(planned, outputs)
    reporter.planned(plan, len({entry.cell.run for entry in planned if entry.finished}))
    closed = plan.ended or not plan.began
    return (plan, set()) if closed and not missing else run_missing(plan, missing, config, outputs, run_cells, reporter)


def run_missing(
    plan: SweepPlan,
    missing: list[CellTask],
    config: Config,
    outputs: Path,
    run_cells: Launch,
    reporter: RunReporter,
    *,
    last: bool = True,
) -> tuple[SweepPlan, set[str]]:
    """Run cells under the parent run of a sweep. Without cells, only end a sweep that was submitted and not waited for.

    Args:
        plan: plan of the sweep.
        missing: its missing cells.
        config: config that gives its tracking and task.
        outputs: output folder.
        run_cells: runs cells.
        reporter: listens to the sweep.
        last: false leaves the parent run open for another call, as a search needs.

    Returns:
        The plan at the end, and the runs that were left to a cluster.
    """
    added = ["trainer.progress=false", f"paths.outputs={outputs}"]
    parent, page = None, None
    plan = replace(plan, began=plan.began or time.time(), ended=0.0)
    plan.write(outputs)
    if config.tracking.kind != "none":
        from sextant.lifecycle.parent_page import ParentPage
        from sextant.tracking.refill import catch_up
        from sextant.tracking.sweep_parent import open_parent

        experiment = config.tracking.experiment or config.task.name
        parent = open_parent(config.tracking.kind, config.tracking.uri, outputs, plan, experiment)
        if parent.run_id not in plan.mlflow_runs:
            plan = replace(plan, mlflow_runs=[*plan.mlflow_runs, parent.run_id])
        plan.write(outputs)
        page = ParentPage(parent, plan, outputs, reporter)
        added.append(f"tracking.parent_run={parent.run_id}")
        catch_up(config.tracking.kind, config.tracking.uri, outputs, reporter)
    try:
        outcomes: Outcomes = []
        if missing:
            with _watched([RunDirectory(cell.run) for cell in missing], reporter, page):
                outcomes = run_cells([replace(cell, overrides=(*cell.overrides, *added)) for cell in missing])
    except BaseException as error:
        plan = _ended(plan, outputs)
        if parent is not None:
            killed = isinstance(error, KeyboardInterrupt | SystemExit)
            parent.status("KILLED" if killed else "FAILED", plan.ended)
        raise
    ended = {cell.run.relative_to(outputs).as_posix(): how for cell, how in zip(missing, outcomes, strict=True)}
    failed = {run: why for run, how in ended.items() if how is not None and (why := _why_failed(how, outputs / run))}
    if missing:
        # runs of other blocks keep what was said of them
        cells = [replace(c, message=failed.get(c.run, "")) if c.run in ended else c for c in plan.cells]
        plan = replace(plan, cells=cells)
    left = {run for run, how in ended.items() if how is None}
    if left or not last:
        plan.write(outputs)
    else:
        from sextant.tracking.mirror import ended_at
        from sextant.tracking.sweep_parent import ended_status

        ends = [] if missing else [ended_at(RunDirectory(outputs / cell.run)) for cell in plan.cells]
        plan = _ended(plan, outputs, max(ends, default=None))
        if page is not None:
            page.end(plan)
        if parent is not None:
            parent.status(ended_status(plan, outputs), plan.ended)
    return plan, left


def _why_failed(how: Mapping[str, Any], run: Path) -> str:
    """Why a run has no results, judged by its outcome and its directory on this host; empty if it has some."""
    if how["status"] == "failed":
        return str(how["message"])
    if RunDirectory(run).results() is not None:
        return ""
    return f"it {how['status']}, but its results are not here: do all hosts share {run.parents[2]}?"


def _ended(plan: SweepPlan, outputs: Path, when: float | None = None) -> SweepPlan:
    plan = replace(plan, ended=when or time.time())
    plan.write(outputs)
    return plan


@contextmanager
def _watched(missing: list[RunDirectory], reporter: RunReporter, page: "ParentPage | None") -> Iterator[None]:
    """Report how many runs are done according to their directories, which works with every launcher."""
    done = threading.Event()

    def watch() -> None:
        with reporter.running() as advance:
            while True:
                advance(sum(run.metrics.is_file() for run in missing), len(missing))
                if page is not None:
                    page.look()
                if done.wait(POLL_S):
                    return

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        done.set()
        watcher.join()


def cell_outcome(cell: Cell, outputs: Path, *, reused: bool, left: bool) -> Outcome:
    """The outcome of the run of a cell, read from its directory."""
    run = RunDirectory(outputs / cell.run)
    results = run.results()
    status: Status = "submitted" if left else "failed"
    return Outcome(status if results is None else results["outcome"], run.path, reused, cell.message)
