"""How far long work is, for whoever wants to show it."""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager

from sextant.data.rendered.lock import notify_stderr

#: called with the number of items that are done and of all
Progress = Callable[[int, int], None]
#: makes a context in which progress is shown
Showing = Callable[[], AbstractContextManager[Progress]]


def notify_every(seconds: float, what: str) -> Progress:
    """A function that prints how far the work is to the standard error, every so often."""
    told = time.monotonic()

    def notify(done: int, total: int) -> None:
        nonlocal told
        if time.monotonic() - told > seconds:
            told = time.monotonic()
            notify_stderr(f"{what}: {done:,}/{total:,} images")

    return notify
