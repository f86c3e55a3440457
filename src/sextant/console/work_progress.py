"""Progress of any long work."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Generic, TypeVar

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from sextant.console.console import console, note_reached
from sextant.reporter import Advance

Thing = TypeVar("Thing")
#: seconds between two lines if there is no terminal
LINE_S = 5.0


@contextmanager
def work_progress(what: str, unit: str) -> Iterator[Advance]:
    """A function that shows progress: a bar on a terminal, or a line every few seconds elsewhere; noted for Ctrl-C."""
    with _shown(what, unit) as show:

        def advance(done: int, total: int) -> None:
            note_reached(what, f"{done:,}/{total:,} {unit}")
            show(done, total)

        yield advance
    note_reached(what, None)


@dataclass(frozen=True)
class Counted(Generic[Thing]):
    """Things one by one, with the progress of the work on them shown."""

    what: str
    unit: str
    things: Sequence[Thing]

    def __len__(self) -> int:
        return len(self.things)

    def __iter__(self) -> Iterator[Thing]:
        with work_progress(self.what, self.unit) as progress:
            for number, thing in enumerate(self.things):
                progress(number, len(self.things))
                yield thing
            progress(len(self.things), len(self.things))


@contextmanager
def _shown(what: str, unit: str) -> Iterator[Advance]:
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
