"""A cell as every launcher sees it: a command line, and the run directory that tells how it ended."""

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
    """A cell.

    Attributes:
        overrides: of the config.
        run: its run directory.
    """

    overrides: tuple[str, ...]
    run: Path

    @property
    def words(self) -> list[str]:
        """The overrides that compose the same config in another process, where a folder of one's own is not known."""
        return [*self.overrides, *search_path()]

    @property
    def name(self) -> str:
        """``<task>/<digest8>-s<seed>``."""
        return f"{self.run.parent.name}/{self.run.name}"


#: why a run failed that the user ended
CANCELLED = "cancelled"

Cells = Sequence[CellTask]
Outcomes = list[dict[str, Any] | None]


def run_here(cell: CellTask, reporter: RunReporter) -> dict[str, Any]:
    """Run a cell in this process."""
    return run_words(cell.words, reporter)


def run_words(words: Sequence[str], reporter: RunReporter) -> dict[str, Any]:
    """Run the cell of these overrides in this process, which may be a worker that has done nothing of ours before."""
    from sextant.tracking.environment import quiet_libraries

    quiet_libraries()
    return execute_cell(to_plain(compose(words)), reporter)


def finished(run: Path) -> dict[str, Any] | None:
    """The outcome of a run that is finished, whoever ran it."""
    results = RunDirectory(run).results()
    if results is None:
        return None
    return {"status": results["outcome"], "directory": str(run), "reused": False, "message": ""}


def failed(run: Path, message: str) -> dict[str, Any]:
    """The outcome of a run that did not get as far as to tell."""
    return {"status": "failed", "directory": str(run), "reused": False, "message": message}
