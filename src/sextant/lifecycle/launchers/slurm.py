"""Cells as tasks of SLURM job arrays, submitted by submitit and watched by their run directories.

SLURM reports on ended jobs only through its accounting (sacct), which many clusters lack, whereas a run directory
always exists. SLURM is therefore queried only for whether a task is still queued and how often it was requeued. Each
start of a task holds a lease while it lives, so that a dead node is noticed.
"""

import logging
import os
import signal
import subprocess
import time
import uuid
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sextant.atomic_files import read_json, write_json
from sextant.config.schema.launchers import SlurmLauncher
from sextant.errors import UserError
from sextant.lease import Lease, look, take
from sextant.lifecycle.launchers.cells import CANCELLED, Cells, CellTask, Outcomes, failed, finished, run_words
from sextant.lifecycle.launchers.slurm_queue import AT_WORK, Queue, Submission, cancel, read_queue, submissions
from sextant.lifecycle.run_reporter import RunReporter
from sextant.runs.sweep_directory import attach_command

POLL_S = 1.0
ASK_S = 10.0  # least time between two queries of the queue
LONGEST_ARRAY = 1000  # SLURM's default
TIMEOUTS = 10_000  # how often a task may reach its time limit and be requeued


@dataclass(frozen=True)
class ArrayTask:
    """The work of one array task: its cells, one after another.

    Attributes:
        cells: for each cell its overrides, and the file that records how it ended.
        alive: folder with a lease for each start of the task.
        lease_s: seconds without a sign of life after which a start counts as dead.
        reporter: listens to the runs.
    """

    cells: tuple[tuple[tuple[str, ...], str], ...]
    alive: str
    lease_s: float
    reporter: RunReporter

    def __call__(self) -> None:
        """Run the cells."""
        signal.signal(signal.SIGTERM, _interrupt)  # submitit ignores it: a preempted task would wait to be killed
        lease = take(Path(self.alive, os.environ.get("SLURM_RESTART_COUNT", "0")), self.lease_s)
        try:
            for words, file in self.cells:
                write_json(Path(file), run_words(words, self.reporter))
        finally:
            if isinstance(lease, Lease):
                lease.release()

    def checkpoint(self) -> Any:
        """Requeue the same work, which skips finished cells; submitit calls this before the time limit is reached."""
        from submitit.helpers import DelayedSubmission

        return DelayedSubmission(self)


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def run_on_slurm(
    cells: Cells, launcher: SlurmLauncher, folder: Path, reporter: RunReporter, runs: RunReporter
) -> Outcomes:
    """Submit the cells that are not yet queued, and wait for all unless ``launcher.wait`` is false."""
    array = _Arrays(launcher, folder, reporter, runs)
    queue, known = read_queue(), _Known(folder)
    array.submit([cell for cell in cells if known.queued(cell, queue) is None or array.told(cell) is not None])
    if not launcher.wait:
        reporter.say(f"submitted; {_commands(folder)}")
        return [None] * len(cells)
    try:
        return array.wait(cells)
    except KeyboardInterrupt:
        cancelled = all(submission.cancelled for submission in submissions(folder))
        told = f"were cancelled; {attach_command(folder)}" if cancelled else f"go on; {_commands(folder)}"
        reporter.say(f"the jobs {told}")
        raise


def _commands(folder: Path) -> str:
    return f"{attach_command(folder)} waits for them, {attach_command(folder, 'cancel')} ends them"


def script(cells: Cells, launcher: SlurmLauncher, folder: Path) -> str:
    """The script that would be given to sbatch."""
    from submitit.slurm.slurm import SlurmExecutor, _make_sbatch_string

    path, count = folder / "slurm" / "dry-run", len(_split(cells, launcher.cells_per_task))
    parameters = {**_parameters(launcher, Submission(path, []).name), "map_count": None if count == 1 else count}
    return str(_make_sbatch_string(command=SlurmExecutor(path)._submitit_command_str, folder=path, **parameters))


class _Known:
    """The array and task that each run was last submitted in."""

    def __init__(self, folder: Path):
        self.place = {
            name: (submission, number)
            for submission in submissions(folder)
            for number, names in enumerate(submission.tasks)
            for name in names
        }

    def queued(self, cell: CellTask, queue: Queue) -> Any:
        submission, number = self.place.get(cell.name, (None, 0))
        return None if submission is None or submission.cancelled else queue.get((submission.name, number))


class _Arrays:
    """The job arrays of one call of the launcher."""

    def __init__(self, launcher: SlurmLauncher, folder: Path, reporter: RunReporter, runs: RunReporter):
        self.launcher, self.folder, self.reporter, self.runs = launcher, folder, reporter, runs
        self.attempts: Counter[Path] = Counter()
        self.missing_since: dict[Path, float] = {}

    def submit(self, cells: Cells) -> None:
        for tasks in _split(_split(cells, self.launcher.cells_per_task), LONGEST_ARRAY):
            self._submit(tasks)

    def _submit(self, tasks: Sequence[Cells]) -> None:
        from submitit.core.utils import FailedJobError
        from submitit.slurm.slurm import SlurmExecutor

        logging.getLogger("submitit").setLevel(logging.ERROR)
        submission = Submission(
            self.folder / "slurm" / uuid.uuid4().hex[:8], [[cell.name for cell in task] for task in tasks]
        )
        for cell in (cell for task in tasks for cell in task):
            self._outcome_file(cell).unlink(missing_ok=True)
            self.attempts[cell.run] += 1
            self.missing_since.pop(cell.run, None)
        submission.write()  # before sbatch, so that after a kill it can be found in the queue by its name
        executor = SlurmExecutor(submission.path, max_num_timeout=TIMEOUTS)
        executor.update_parameters(**_parameters(self.launcher, submission.name))
        work = [
            ArrayTask(
                tuple((tuple(cell.words), str(self._outcome_file(cell))) for cell in task),
                str(submission.alive(number)),
                self.launcher.lease_s,
                self.runs,
            )
            for number, task in enumerate(tasks)
        ]
        try:
            executor.submit_array(work)
        except (FailedJobError, subprocess.CalledProcessError) as error:
            said = str(error).strip().splitlines()
            raise UserError(f"sbatch refused the job array: {said[-1] if said else error}", "See launcher.*") from None

    def _outcome_file(self, cell: CellTask) -> Path:
        return self.folder / "outcomes" / f"{cell.run.parent.name}-{cell.run.name}.json"

    def told(self, cell: CellTask) -> dict[str, Any] | None:
        """The outcome that its task recorded; the task itself may still be working on other cells."""
        told = read_json(self._outcome_file(cell))
        return told if isinstance(told, dict) else None

    def wait(self, cells: Cells) -> Outcomes:
        """Wait until each cell has ended; resubmit those that vanished from the queue without a trace."""
        outcomes: dict[Path, dict[str, Any]] = {}
        ask_s, asked = min(ASK_S, self.launcher.lease_s / 3), time.monotonic()
        while True:
            for cell in cells:
                if cell.run not in outcomes and (found := finished(cell.run) or self.told(cell)) is not None:
                    outcomes[cell.run] = found
            left = [cell for cell in cells if cell.run not in outcomes]
            if not left:
                return [outcomes[cell.run] for cell in cells]
            if time.monotonic() - asked > ask_s:
                outcomes |= self._look_after(left)
                asked = time.monotonic()
            time.sleep(POLL_S)

    def _look_after(self, cells: Cells) -> dict[Path, dict[str, Any]]:
        """Resubmit lost cells, and return the outcomes of those that are given up."""
        try:
            queue = read_queue()
        except UserError as error:  # SLURM may be restarting while its tasks go on
            self.reporter.say(f"{error.problem}; waiting for it")
            return {}
        known, given_up, again = _Known(self.folder), {}, []
        for cell in cells:
            submission, number = known.place[cell.name]
            if submission.cancelled:
                given_up[cell.run] = failed(cell.run, CANCELLED)
            elif self._is_lost(cell, queue, submission, number):
                if self.attempts[cell.run] < self.launcher.attempts:
                    self.reporter.say(f"{cell.name} vanished from the queue, or its node did; it is resubmitted")
                    again.append(cell)
                else:
                    given_up[cell.run] = failed(cell.run, self._vanished(submission, number))
        self.submit(again)
        return given_up

    def _is_lost(self, cell: CellTask, queue: Queue, submission: Submission, number: int) -> bool:
        """Whether its task has for a while been missing from the queue, or running without a sign of life.

        Only the lease of the current start counts. A task that is just starting has no lease yet, a requeued task has
        left a dead one, and the task's later runs may have been begun by other processes.
        """
        queued = queue.get((submission.name, number))
        if queued is not None:
            held = look(submission.alive(number) / queued.restarts) if queued.state in AT_WORK else None
            if held is None or held[1]:
                self.missing_since.pop(cell.run, None)
                return False
        since = self.missing_since.setdefault(cell.run, time.monotonic())
        if time.monotonic() - since < self.launcher.lease_s:
            return False
        if queued is not None:  # its node died before SLURM noticed
            try:
                cancel([queued.job])
            except UserError:  # it has ended, or SLURM does not answer: decided at the next check
                return False
        return True

    def _vanished(self, submission: Submission, number: int) -> str:
        log = submission.log(number)
        told = f"its log is {log}" if log else f"no log was written: do all nodes share {self.folder}?"
        return f"its task ended {self.launcher.attempts} times without recording an outcome; {told}"


def _split(items: Sequence[Any], size: int) -> list[Sequence[Any]]:
    return [items[start : start + size] for start in range(0, len(items), size)]


def _parameters(launcher: SlurmLauncher, name: str) -> dict[str, Any]:
    """The parameters of submitit's executor."""
    given: dict[str, Any] = {
        "job_name": name,
        "time": launcher.time_min,
        "signal_delay_s": min(90, 15 * launcher.time_min),
        "nodes": 1,
        "ntasks_per_node": 1,
        "cpus_per_task": launcher.cpus,
        "gpus_per_node": launcher.gpus or None,
        "mem": launcher.memory_gb and f"{int(1024 * launcher.memory_gb)}MB",
        "partition": launcher.partition,
        "account": launcher.account,
        "qos": launcher.qos,
        "array_parallelism": launcher.at_once or LONGEST_ARRAY,
        "stderr_to_stdout": True,
        "use_srun": launcher.srun,
        "setup": launcher.setup or None,
        "additional_parameters": {"requeue": True, **launcher.options},
    }
    return {key: value for key, value in given.items() if value is not None}
