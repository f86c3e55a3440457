"""Progress of any long work."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from sextant.cli.console import console
from sextant.reporter import Advance

#: seconds between two lines if there is no terminal
LINE_S = 5.0


@contextmanager
def work_progress(what: str, unit: str) -> Iterator[Advance]:
    """A function that shows progress: a bar on a terminal, or a line every few seconds elsewhere."""
    if not console.is_terminal:
        drawn = time.monotonic()

        def line(done: int, total: int) -> None:
            nonlocal drawn
            if time.monotonic() - drawn > LINE_S:
                drawn = time.monotonic()
                console.print(f"{what} {done:,}/{total:,} {unit}")

        yield line
        return
    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
