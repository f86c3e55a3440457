"""What SLURM says of the job arrays of a sweep, and what was noted of them before they were submitted."""

import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sextant.atomic_files import read_json, write_json
from sextant.config.schema.launchers import SlurmLauncher
from sextant.errors import UserError

#: states in which a task is or will be running; all others are the end of it
AT_WORK = ("RUNNING", "SUSPENDED", "STOPPED", "SIGNALING", "STAGE_OUT")
ALIVE = (*AT_WORK, "PENDING", "CONFIGURING", "REQUEUED", "REQUEUE_FED", "REQUEUE_HOLD", "RESIZING", "SPECIAL_EXIT")


@dataclass(frozen=True)
class Submission:
    """A job array.

    Attributes:
        path: its folder, with what submitit keeps there, and the logs.
        tasks: for each task of the array the names of its runs, in order.
        cancelled: it was, by the user.
    """

    path: Path
    tasks: list[list[str]]
    cancelled: bool = False

    @property
    def name(self) -> str:
        """The name under which it is in the queue, and that nothing else has."""
        return f"sextant-{self.path.parents[1].name}-{self.path.name}"

    def write(self) -> None:
        """Note it."""
        write_json(self.path / "tasks.json", {"tasks": self.tasks, "cancelled": self.cancelled})

    def alive(self, task: int) -> Path:
        """The folder in which each start of a task, by its number, has a lease."""
        return self.path / "alive" / str(task)

    def log(self, task: int) -> Path | None:
        """What a task printed."""
        found = [
            *self.path.glob(f"*_{task}_0_log.out"),
            *(self.path.glob("*_0_log.out") if len(self.tasks) == 1 else ()),
        ]
        return found[0] if found else None


@dataclass(frozen=True)
class Queued:
    """A task in the queue: its job, its state, the node it runs on or why it waits, how often it was queued again."""

    job: str
    state: str
    where: str
    restarts: str


#: what squeue is asked for; it cuts off what is longer than the number
FIELDS = "Name:500|,ArrayTaskID:30|,ArrayJobID:30|,State:30|,RestartCnt:10|,ReasonList:500"

#: name of an array and number of a task in it -> what the queue says of it
Queue = dict[tuple[str, int], Queued]


def submissions(folder: Path) -> list[Submission]:
    """Those of a sweep's folder, the oldest first."""
    found = [(file.stat().st_mtime_ns, file) for file in folder.glob("slurm/*/tasks.json")]
    read = [(file.parent, read_json(file)) for _, file in sorted(found)]
    return [Submission(path, said["tasks"], said["cancelled"]) for path, said in read if isinstance(said, dict)]


def read_queue() -> Queue:
    """The tasks of this user that are in the queue.

    Raises:
        UserError: this machine has no squeue, or the controller of SLURM does not answer.
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
    """End jobs, or tasks of arrays."""
    if jobs:
        _ask("scancel", *jobs)


def cancel_all(folder: Path) -> int:
    """End all that a sweep has in the queue; how many tasks there were.

    Raises:
        UserError: as :func:`read_queue`; nothing is noted then.
    """
    read_queue()
    ours = submissions(folder)
    for submission in ours:  # first, so that nobody who waits for them submits them again
        Submission(submission.path, submission.tasks, cancelled=True).write()
    names, queue = {submission.name for submission in ours}, read_queue()  # with what was submitted until now
    jobs = [queued.job for (name, _), queued in queue.items() if name in names]
    cancel(jobs)
    return len(jobs)


def require_commands(launcher: SlurmLauncher) -> None:
    """Raise a ``UserError`` unless the commands of SLURM are there and the partition exists."""
    needed = ["sbatch", "squeue", "scancel", "sinfo", "srun"]  # submitit wants the last one, used or not
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
