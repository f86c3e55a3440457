"""Progress of long work, for callers that show it."""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager

from sextant.data.rendered.lock import log
from sextant.reporter import Advance

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
