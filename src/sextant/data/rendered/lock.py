"""The lock that lets one process at a time write to a store, across hosts, and the progress shown to others."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from sextant.data.rendered.disk import reporting_disk_errors
from sextant.lease import Holder, take
from sextant.reporter import Advance

Notify = Callable[[str], None]
POLL_S = 0.2
#: logger of the data package; the commands show its messages to the user
log = logging.getLogger("sextant.data")


@contextmanager
def store_lock(directory: Path, ready: Callable[[], bool], notify: Notify) -> Iterator[bool]:
    """Hold the lock of the store at ``directory``; it is released when the process ends, however it ends.

    While another process holds it, this waits, and reports once which process that is.

    Args:
        directory: of the store; the lock lies beside it and outlives it.
        ready: polled a few times per second while waiting; returns True if there is nothing left to do.
        notify: receives the message.

    Yields:
        Whether the lock is held; False once ``ready`` returned True.

    Raises:
        UserError: the lock cannot be written.
    """
    told = False
    while True:
        with reporting_disk_errors(directory.parent, lambda: 0):
            lease = take(directory.parent / ".locks" / directory.name)
        if not isinstance(lease, Holder):
            break
        if not told:
            notify(f"waiting for {lease}, which is rendering {directory.name}")
            told = True
        if ready():
            yield False
            return
        time.sleep(POLL_S)
    try:
        yield True
    finally:
        lease.release()


#: makes a context in which progress is shown
Showing = Callable[[], AbstractContextManager[Advance]]


def notify_every(seconds: float, what: str) -> Advance:
    """A function that logs progress at most once every ``seconds``."""
    told = time.monotonic()

    def notify(done: int, total: int) -> None:
        nonlocal told
        if time.monotonic() - told > seconds:
            told = time.monotonic()
            log.info("%s: %s/%s images", what, f"{done:,}", f"{total:,}")

    return notify
