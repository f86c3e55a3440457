"""One run in several processes of this machine: this one, which holds its lock and writes, and those it starts."""

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
ENDS_S = 60.0  # how long another process may take to end after the last step
DIES_S = 5.0  # and to be seen to have died once it is not heard of any more
PROGRAM = "import json, sys; given = json.loads(sys.stdin.readline()); sys.path[:] = given['path']; "
PROGRAM += "from sextant.lifecycle.rank_process import main; main(given); "
PROGRAM += (
    "import os; os._exit(0)"  # nothing is left to do; gloo's threads now and then abort a process that takes leave
)


class Rank(LightningEnvironment):
    """Tells Lightning which of the processes of a run this one is, and where they meet.

    Args:
        number: of this process; 0 is the one that writes.
        meeting: a file that is not there yet, in a folder of the user's alone. A port would be open to every process of
            the machine, and to others.
    """

    def __init__(self, number: int, meeting: str):
        super().__init__()
        self.number, self.meeting = number, meeting

    @property
    def creates_processes_externally(self) -> bool:
        """Lightning would start the command line anew, which would wait for the lock of its own run."""
        return True

    def local_rank(self) -> int:
        """The number, as all processes are on this machine."""
        return self.number


class Processes(DDPStrategy):
    """Distributed data-parallel training in processes that are there; no launcher, which would set their threads."""

    def _configure_launcher(self) -> None:
        pass

    def setup_environment(self) -> None:
        """Meet the other processes; gradients go over the loopback interface."""
        rank = self.cluster_environment
        assert isinstance(rank, Rank)
        assert self.parallel_devices is not None
        for name in ("GLOO_SOCKET_IFNAME", "NCCL_SOCKET_IFNAME"):
            if any(interface == LOOPBACK for _, interface in socket.if_nameindex()):
                os.environ.setdefault(name, LOOPBACK)
        torch.distributed.init_process_group(
            self._get_process_group_backend(),
            init_method=f"file://{rank.meeting}",
            rank=rank.number,
            world_size=len(self.parallel_devices),
        )
        super().setup_environment()  # which finds the group


@dataclass(frozen=True)
class _Other:
    """Another process of the run, and what it says of an error."""

    number: int
    process: subprocess.Popen[str]
    errors: IO[str]

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        self.errors.close()

    def require_well(self, wait_s: float) -> None:
        """Raise a ``UserError`` if it ended, or ends within so many seconds, and not well."""
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(wait_s)
        if self.process.poll():
            self.errors.seek(0)
            said = (self.errors.read().strip() or f"by signal {-self.process.returncode}").splitlines()[-1]
            raise UserError(
                f"process {self.number} of this run ended: {said}",
                "Is there memory for all trainer.devices? The same command goes on from the last epoch.",
            )


@contextmanager
def ranks(config: Config, directory: RunDirectory, key: RunKey, *, resume: bool) -> Iterator[Rank | None]:
    """Start the other processes of a run, as many as ``trainer.devices`` asks for; None if it needs no other.

    They end when this process does, however it ends.

    Args:
        config: of the run.
        directory: of the run; the others only read from it.
        key: of the run.
        resume: whether to go on from its last checkpoint.

    Raises:
        UserError: one of them died.
    """
    if config.trainer.devices == 1:
        yield None
        return
    folder = tempfile.TemporaryDirectory()  # of this user alone
    rank = Rank(0, str(Path(folder.name) / "meeting"))
    given = {"config": config.plain, "directory": str(directory.path), "key": asdict(key), "resume": resume}
    others: list[_Other] = []
    try:
        others += (_start(n, {**given, "meeting": rank.meeting}) for n in range(1, config.trainer.devices))
        yield rank
        _require_well(others, ENDS_S)
    except RuntimeError:  # that of torch: the connection to another one was lost
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
        start_new_session=True,  # Ctrl-C is for the first process, which ends the others
    )
    assert process.stdin is not None
    process.stdin.write(json.dumps({**given, "rank": number, "path": sys.path}) + "\n")
    process.stdin.flush()  # and stays open: that it closes is how the other one notices the end of this process
    return _Other(number, process, errors)
