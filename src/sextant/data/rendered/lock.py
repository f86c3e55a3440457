"""One process at a time writes to a store, on however many hosts."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from sextant.data.rendered.disk import reporting_disk_errors
from sextant.lease import Holder, take

Notify = Callable[[str], None]
POLL_S = 0.2
#: of this room; its messages are for whoever started the work, and are shown by the commands
log = logging.getLogger("sextant.data")


@contextmanager
def store_lock(directory: Path, ready: Callable[[], bool], notify: Notify) -> Iterator[bool]:
    """Hold the lock of the store at ``directory``; it is free when the process ends, however it ends.

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
