"""The state of a sweep's job arrays in SLURM's queue, and the records made before they were submitted."""

import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sextant.atomic_files import read_json, write_json
from sextant.config.schema.launchers import SlurmLauncher
from sextant.errors import UserError

#: states in which a task is running or will run; all others mean that it has ended
AT_WORK = ("RUNNING", "SUSPENDED", "STOPPED", "SIGNALING", "STAGE_OUT")
ALIVE = (*AT_WORK, "PENDING", "CONFIGURING", "REQUEUED", "REQUEUE_FED", "REQUEUE_HOLD", "RESIZING", "SPECIAL_EXIT")


@dataclass(frozen=True)
class Submission:
    """A job array.

    Attributes:
        path: its folder, which holds submitit's files and the logs.
        tasks: for each task of the array, the names of its runs in order.
        cancelled: whether the user cancelled it.
    """

    path: Path
    tasks: list[list[str]]
    cancelled: bool = False

    @property
    def name(self) -> str:
        """Its unique name in the queue."""
        return f"sextant-{self.path.parents[1].name}-{self.path.name}"

    def write(self) -> None:
        """Record the submission in its folder."""
        write_json(self.path / "tasks.json", {"tasks": self.tasks, "cancelled": self.cancelled})

    def alive(self, task: int) -> Path:
        """The folder that holds a lease for each start of a task, named by the number of the start."""
        return self.path / "alive" / str(task)

    def log(self, task: int) -> Path | None:
        """The log file of a task, None if there is none."""
        found = [
            *self.path.glob(f"*_{task}_0_log.out"),
            *(self.path.glob("*_0_log.out") if len(self.tasks) == 1 else ()),
        ]
        return found[0] if found else None


@dataclass(frozen=True)
class Queued:
    """A task in the queue: its job, state, node or reason for waiting, and how often it was requeued."""

    job: str
    state: str
    where: str
    restarts: str


#: fields requested from squeue, which truncates each to the given length
FIELDS = "Name:500|,ArrayTaskID:30|,ArrayJobID:30|,State:30|,RestartCnt:10|,ReasonList:500"

#: name of an array and number of a task in it -> its entry in the queue
Queue = dict[tuple[str, int], Queued]


def submissions(folder: Path) -> list[Submission]:
    """The submissions in a sweep's folder, oldest first."""
    found = [(file.stat().st_mtime_ns, file) for file in folder.glob("slurm/*/tasks.json")]
    read = [(file.parent, read_json(file)) for _, file in sorted(found)]
    return [Submission(path, said["tasks"], said["cancelled"]) for path, said in read if isinstance(said, dict)]


def read_queue() -> Queue:
    """The user's tasks that are in the queue.

    Raises:
        UserError: this machine has no squeue, or SLURM's controller does not answer.
    """
    text = _ask("squeue", "--noheader", "--array", f"--user={os.getuid()}", f"--Format={FIELDS}")
    queue: Queue = {}
    for line in text.splitlines():
        name, number, job, state, restarts, where = (word.strip() for word in line.split("|", 5))
        task = int(number) if number.isdigit() else 0
        if state in ALIVE:
            job = f"{job}_{number}" if number.isdigit() else job
            queue[name, task] = Queued(job, state, where.strip("()"), restarts)
    return queue


def cancel(jobs: Sequence[str]) -> None:
    """Cancel jobs, or tasks of arrays."""
    if jobs:
        _ask("scancel", *jobs)


def cancel_all(folder: Path) -> int:
    """Cancel all tasks that a sweep has in the queue, and return their number.

    Raises:
        UserError: as :func:`read_queue`; no submission is marked as cancelled then.
    """
    read_queue()
    ours = submissions(folder)
    for submission in ours:  # first, so that no waiting process resubmits them
        Submission(submission.path, submission.tasks, cancelled=True).write()
    names, queue = {submission.name for submission in ours}, read_queue()  # including anything submitted meanwhile
    jobs = [queued.job for (name, _), queued in queue.items() if name in names]
    cancel(jobs)
    return len(jobs)


def require_commands(launcher: SlurmLauncher) -> None:
    """Raise a ``UserError`` unless SLURM's commands are installed and the partition exists."""
    needed = ["sbatch", "squeue", "scancel", "sinfo", "srun"]  # submitit requires srun even where it is not used
    missing = [command for command in needed if shutil.which(command) is None]
    if missing:
        raise UserError(
            f"launcher=slurm: this machine has no {', '.join(missing)}",
            "Start the sweep where jobs are submitted, or choose launcher=joblib or launcher=ray.",
        )
    partitions = [word.rstrip("*") for word in _ask("sinfo", "--noheader", "--format=%P").split()]
    if launcher.partition is not None and not set(launcher.partition.split(",")) <= set(partitions):
        raise UserError(
            f"launcher.partition={launcher.partition}: no such partition", f"Partitions: {', '.join(partitions)}"
        )


def _ask(*command: str) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise UserError(f"{command[0]}: {error.strerror}", "Do this on a host that has SLURM's commands.") from None
    if done.returncode:
        raise UserError(f"{command[0]}: {done.stderr.strip() or done.returncode}", "sinfo shows whether SLURM answers.")
    return done.stdout
