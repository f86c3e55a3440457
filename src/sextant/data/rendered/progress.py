"""How far long work is, for whoever wants to show it."""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager

from sextant.data.rendered.lock import log

#: called with the number of items that are done and of all
Progress = Callable[[int, int], None]
#: makes a context in which progress is shown
Showing = Callable[[], AbstractContextManager[Progress]]


def notify_every(seconds: float, what: str) -> Progress:
    """A function that logs how far the work is, every so often."""
    told = time.monotonic()

    def notify(done: int, total: int) -> None:
        nonlocal told
        if time.monotonic() - told > seconds:
            told = time.monotonic()
            log.info("%s: %s/%s images", what, f"{done:,}", f"{total:,}")

    return notify
