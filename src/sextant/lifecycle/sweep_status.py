"""Status and cancellation of a sweep that runs in another process or on a cluster."""

import os
import signal
from dataclasses import dataclass
from pathlib import Path

from sextant.errors import UserError, one_line
from sextant.lease import Holder
from sextant.lifecycle.launchers.slurm_queue import cancel_all, read_queue, submissions
from sextant.reporter import SILENT, Reporter
from sextant.runs.directory import RunDirectory
from sextant.runs.locks import run_holder, sweep_holder
from sextant.runs.sweep_directory import attach_command, read_plan


@dataclass(frozen=True)
class RunState:
    """The state of one run of a sweep.

    Attributes:
        run: ``<task>/<digest8>-s<seed>``.
        state: ``finished``, ``diverged``, ``failed``, ``running``, ``queued``, ``silent`` (its process or host gives no
            sign of life any more) or ``missing``.
        where: the process or job that computes it, or why it failed.
    """

    run: str
    state: str
    where: str = ""


def sweep_status(directory: Path, reporter: Reporter = SILENT) -> tuple[list[RunState], Holder | None]:
    """The state of each run of a sweep, and the process that runs the sweep, None if there is none.

    Args:
        directory: directory of the sweep.
        reporter: gets a message if SLURM does not answer; the state in the run directories is reported nevertheless.

    Raises:
        UserError: the sweep's files are damaged.
    """
    plan, outputs = read_plan(directory), directory.parents[1]
    messages = {cell.run: cell.message for cell in plan.cells}
    queued = _queued(directory, reporter)
    return [_state(outputs / run, message, queued) for run, message in messages.items()], sweep_holder(directory)


def _queued(directory: Path, reporter: Reporter) -> dict[str, str]:
    """The runs that are in SLURM's queue, with a description of their jobs."""
    ours = submissions(directory)
    try:
        queue = read_queue() if ours else {}
    except UserError as error:
        reporter.say(f"{one_line(error.problem)}; runs that wait in SLURM's queue are not shown as such")
        queue = {}
    return {
        name: f"job {entry.job}: {entry.state.lower()}, {entry.where}"
        for submission in ours
        for number, names in enumerate(submission.tasks)
        for name in names
        if (entry := queue.get((submission.name, number))) is not None
    }


def _state(run: Path, message: str, queued: dict[str, str]) -> RunState:
    name = f"{run.parent.name}/{run.name}"
    results, held = RunDirectory(run).results(), run_holder(run)
    if results is not None:
        return RunState(name, results["outcome"])
    if held is not None and held[1]:
        return RunState(name, "running", str(held[0]))
    if name in queued:
        return RunState(name, "queued", queued[name])
    if held is not None:
        return RunState(name, "silent", str(held[0]))
    failure = message or RunDirectory(run).state().get("failure")
    return RunState(name, "failed", str(failure).splitlines()[0]) if failure else RunState(name, "missing")


def cancel_sweep(directory: Path) -> str:
    """Cancel a sweep: end its jobs in SLURM's queue, and interrupt the process that runs it on this host.

    Returns:
        A description of what was ended.

    Raises:
        UserError: the sweep is not running, it runs on another host, or SLURM does not answer.
    """
    said, silent = [], None
    if submissions(directory):
        try:
            said.append(f"{cancel_all(directory)} tasks cancelled")
        except UserError as error:  # it may by now be run on this host without SLURM
            silent = error
    holder = sweep_holder(directory)
    if holder is not None and holder.here:
        os.kill(holder.process, signal.SIGINT)
        said.append(f"{holder} was interrupted")
    if silent is not None:
        raise UserError("; ".join([*said, f"nothing was cancelled in SLURM's queue: {silent.problem}"]), silent.fix)
    if holder is not None and not holder.here:
        elsewhere = f"{directory.name} is run by {holder}, another host"
        if not said:
            raise UserError(elsewhere, "End it there, with Ctrl-C.")
        said.append(f"{elsewhere}: if it does not end by itself, end it there, with Ctrl-C")
    if not said:
        raise UserError(
            f"{directory.name} is not running", f"{attach_command(directory, 'status')} shows how far it is."
        )
    return f"{'; '.join(said)}; the same command, or {attach_command(directory)}, continues it"
