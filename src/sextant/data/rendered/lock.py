"""One process at a time writes to a store."""

import os
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import BaseFileLock, FileLock, Timeout

from sextant.data.rendered.disk import reporting_disk_errors

Notify = Callable[[str], None]
POLL_S = 0.2


def notify_stderr(message: str) -> None:
    """Print a message for the user, apart from what the program puts out."""
    print(message, file=sys.stderr, flush=True)


@contextmanager
def store_lock(directory: Path, ready: Callable[[], bool], notify: Notify) -> Iterator[bool]:
    """Hold the lock of the store at ``directory``; the system frees it when the process ends, however it ends.

    While another process holds it, waits, and says once for whom.

    Args:
        directory: of the store; its lock lies beside it and outlives it.
        ready: asked a few times a second while waiting: there is nothing left to do.
        notify: gets the message.

    Yields:
        Whether the lock is held; false once ``ready`` said so.

    Raises:
        UserError: the lock cannot be written.
    """
    locks = directory.parent / ".locks"
    with reporting_disk_errors(directory.parent, lambda: 0):
        locks.mkdir(parents=True, exist_ok=True)
    owner = locks / f"{directory.name}.owner"
    lock = FileLock(locks / f"{directory.name}.lock", thread_local=False)
    held, told = False, False
    while True:
        with reporting_disk_errors(directory.parent, lambda: 0):
            held = _acquired(lock, POLL_S if told else 0)
        if held:
            break
        if not told:
            notify(f"waiting for {_read(owner)}, which is rendering {directory.name}")
            told = True
        if ready():
            break
    try:
        if held:
            with suppress(OSError):  # who holds it is a courtesy; a full disk must not keep anyone from reading
                owner.write_text(f"process {os.getpid()} on {socket.gethostname()}")
        yield held
    finally:
        if held:
            lock.release()


def _acquired(lock: BaseFileLock, timeout: float) -> bool:
    try:
        lock.acquire(timeout=timeout)
    except Timeout:
        return False
    return True


def _read(owner: Path) -> str:
    with suppress(OSError):
        return owner.read_text() or "another process"
    return "another process"
