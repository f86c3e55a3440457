"""One run in several processes of this machine: this one holds the lock and writes, and it starts the others."""

import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO

import torch
from lightning_fabric.plugins.environments.lightning import LightningEnvironment
from pytorch_lightning.strategies import DDPStrategy

from sextant.config import Config
from sextant.errors import UserError
from sextant.runs.directory import RunDirectory, RunKey

LOOPBACK = "lo"
ENDS_S = 60.0  # time that another process may take to end after the last step
DIES_S = 5.0  # time within which a lost process must be found to have died
PROGRAM = "import json, sys; given = json.loads(sys.stdin.readline()); sys.path[:] = given['path']; "
PROGRAM += "from sextant.lifecycle.rank_process import main; main(given); "
PROGRAM += "import os; os._exit(0)"  # skips clean-up, in which gloo's threads sometimes abort the process


class Rank(LightningEnvironment):
    """Gives Lightning the rank of this process, and the file through which the processes of a run connect.

    Args:
        number: rank of this process; rank 0 is the one that writes.
        meeting: a file that does not exist yet, in a folder private to the user. A port would be open to every process
            of the machine, and to others.
    """

    def __init__(self, number: int, meeting: str):
        super().__init__()
        self.number, self.meeting = number, meeting

    @property
    def creates_processes_externally(self) -> bool:
        """True: Lightning itself would rerun the command line, which would wait for the lock of its own run."""
        return True

    def local_rank(self) -> int:
        """The rank itself, as all processes are on this machine."""
        return self.number


class Processes(DDPStrategy):
    """Distributed data-parallel training in existing processes, without a launcher, which would set their threads."""

    def _configure_launcher(self) -> None:
        pass

    def setup_environment(self) -> None:
        """Connect to the other processes; gradients go over the loopback interface."""
        rank = self.cluster_environment
        assert isinstance(rank, Rank)
        assert self.parallel_devices is not None
        for name in ("GLOO_SOCKET_IFNAME", "NCCL_SOCKET_IFNAME"):
            if any(interface == LOOPBACK for _, interface in socket.if_nameindex()):
                os.environ.setdefault(name, LOOPBACK)
        torch.distributed.init_process_group(
            self._get_process_group_backend(),
            store=torch.distributed.FileStore(  # type: ignore[attr-defined]
                rank.meeting, len(self.parallel_devices)
            ),
            rank=rank.number,
            world_size=len(self.parallel_devices),
        )
        super().setup_environment()  # finds the existing group


@dataclass(frozen=True)
class _Other:
    """Another process of the run, and its error output."""

    number: int
    process: subprocess.Popen[str]
    errors: IO[str]

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        self.errors.close()

    def require_well(self, wait_s: float) -> None:
        """Raise a ``UserError`` if it has failed, or fails within ``wait_s`` seconds."""
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(wait_s)
        if self.process.poll():
            self.errors.seek(0)
            said = (self.errors.read().strip() or f"by signal {-self.process.returncode}").splitlines()[-1]
            raise UserError(
                f"process {self.number} of this run ended: {said}",
                "Is there enough memory for all trainer.devices? The same command resumes after the last epoch.",
            )


@contextmanager
def ranks(config: Config, directory: RunDirectory, key: RunKey, *, resume: bool) -> Iterator[Rank | None]:
    """Start the other processes that ``trainer.devices`` requires, and yield this one's rank; None if there are none.

    They end when this process does, however it ends.

    Args:
        config: the run's config.
        directory: the run's directory, from which the others only read.
        key: the run's key.
        resume: whether to resume from the last checkpoint.

    Raises:
        UserError: one of the processes died.
    """
    if config.trainer.devices == 1:
        yield None
        return
    folder = tempfile.TemporaryDirectory()  # private to this user
    rank = Rank(0, str(Path(folder.name) / "meeting"))
    given = {"config": config.plain, "directory": str(directory.path), "key": asdict(key), "resume": resume}
    others: list[_Other] = []
    try:
        others += (_start(n, {**given, "meeting": rank.meeting}) for n in range(1, config.trainer.devices))
        yield rank
        _require_well(others, ENDS_S)
    except RuntimeError:  # raised by torch when the connection to another process is lost
        _require_well(others, DIES_S)
        raise
    finally:
        if torch.distributed.is_initialized():
            torch.distributed.destroy_process_group()
        for other in others:
            other.end()
        folder.cleanup()


def _require_well(others: Sequence[_Other], within_s: float) -> None:
    until = time.monotonic() + within_s
    for other in others:
        other.require_well(max(0.0, until - time.monotonic()))


def _start(number: int, given: dict[str, object]) -> _Other:
    errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 - closed with the process
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=errors,
        text=True,
        start_new_session=True,  # Ctrl-C reaches only the first process, which ends the others
    )
    assert process.stdin is not None
    process.stdin.write(json.dumps({**given, "rank": number, "path": sys.path}) + "\n")
    process.stdin.flush()  # stays open: its closing signals to the other process that this one has ended
    return _Other(number, process, errors)
