"""One process per run directory."""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from sextant.errors import UserError


class LockedError(UserError):
    """Another process holds the lock of a run."""


@contextmanager
def run_lock(folder: Path, name: str, wait: bool) -> Iterator[None]:
    """Hold the lock of the runs called ``name``; the system frees it when the process ends, however it ends.

    Args:
        folder: the task's folder of run directories.
        name: the run's name.
        wait: wait for another process, as sweeps do, rather than give up.

    Raises:
        LockedError: another process holds the lock and ``wait`` is false; names it.
    """
    locks = folder / ".locks"
    locks.mkdir(parents=True, exist_ok=True)
    owner = locks / f"{name}.owner"
    lock = FileLock(locks / f"{name}.lock")
    try:
        lock.acquire(timeout=-1 if wait else 0)
    except Timeout:
        who = owner.read_text() if owner.is_file() else "another process"
        raise LockedError(
            f"{folder.name}/{name} is being run by {who}", "Wait for it, or end it; the run can be resumed then."
        ) from None
    try:
        owner.write_text(f"process {os.getpid()} on {socket.gethostname()}")
        yield
    finally:
        lock.release()
