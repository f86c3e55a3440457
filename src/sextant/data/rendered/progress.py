"""How far long work is, for whoever wants to show it."""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager

from sextant.data.rendered.lock import tell_stderr

#: called with the number of items that are done and of all
Progress = Callable[[int, int], None]
#: makes a context in which progress is shown
Showing = Callable[[], AbstractContextManager[Progress]]


def telling_every(seconds: float, what: str) -> Progress:
    """A function that prints how far the work is to the standard error, every so often."""
    told = time.monotonic()

    def tell(done: int, total: int) -> None:
        nonlocal told
        if time.monotonic() - told > seconds:
            told = time.monotonic()
            tell_stderr(f"{what}: {done:,}/{total:,} images")

    return tell
