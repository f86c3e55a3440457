"""Cells for launchers: a command line, and the run directory that records how it ended."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sextant.composing.compose import compose, to_plain
from sextant.composing.config_files import search_path
from sextant.lifecycle.execute import execute_cell
from sextant.lifecycle.run_reporter import RunReporter
from sextant.runs.directory import RunDirectory


@dataclass(frozen=True)
class CellTask:
    """One run of a sweep, to be launched.

    Attributes:
        overrides: overrides of the config.
        run: the run directory.
    """

    overrides: tuple[str, ...]
    run: Path

    @property
    def words(self) -> list[str]:
        """The overrides that compose the same config in a process without the user's own config folder."""
        return [*self.overrides, *search_path()]

    @property
    def name(self) -> str:
        """``<task>/<digest8>-s<seed>``."""
        return f"{self.run.parent.name}/{self.run.name}"


#: message of a run that failed because the user cancelled it
CANCELLED = "cancelled"

Cells = Sequence[CellTask]
Outcomes = list[dict[str, Any] | None]


def run_here(cell: CellTask, reporter: RunReporter) -> dict[str, Any]:
    """Run a cell in this process."""
    return run_words(cell.words, reporter)


def run_words(words: Sequence[str], reporter: RunReporter) -> dict[str, Any]:
    """Run the cell of these overrides in this process, which may be a fresh worker."""
    from sextant.tracking.environment import quiet_libraries

    quiet_libraries()
    return execute_cell(to_plain(compose(words)), reporter)


def finished(run: Path) -> dict[str, Any] | None:
    """The outcome of a finished run, whoever computed it; None if it is not finished."""
    results = RunDirectory(run).results()
    if results is None:
        return None
    return {"status": results["outcome"], "directory": str(run), "reused": False, "message": ""}


def failed(run: Path, message: str) -> dict[str, Any]:
    """The outcome of a run that ended without reporting one."""
    return {"status": "failed", "directory": str(run), "reused": False, "message": message}
