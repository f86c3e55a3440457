"""The trials of a search, and their results from the run directories."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sextant.errors import UserError
from sextant.evaluation.racing import Scores, leader, seeds_run
from sextant.lifecycle.search.design import SearchDesign
from sextant.lifecycle.sweep_plan import Planned
from sextant.reports.search_results import metric_of_test
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import Cell


@dataclass(frozen=True)
class Trial:
    """A trial: one point of the space.

    Attributes:
        setting: the value of each key.
        planned: its runs, first at the seeds of the search and then at the fresh ones; empty if its config is invalid.
        problem: what is wrong with its config.
    """

    number: int
    setting: Mapping[str, str]
    planned: list[Planned] = field(default_factory=list)
    problem: str = ""

    @property
    def arm(self) -> str:
        """The trial's name in the plan."""
        return arm_of(self.number)


def arm_of(number: int) -> str:
    """The name of a trial in the plan."""
    return f"trial {number}"


class Table:
    """Trials x seeds, from the run directories.

    Args:
        design: design of the search.
        outputs: output folder.
    """

    def __init__(self, design: SearchDesign, outputs: Path):
        self.design, self.outputs = design, outputs
        self.trials: list[Trial] = []
        self.failed: dict[str, str] = {}
        self._finished: dict[str, dict[str, Any]] = {}
        self._known = ""

    def scores(self) -> Scores:
        """The metric of each run, signed so that higher is better; nan if not run, minus infinity without a result.

        A failed run counts as one without a result for the rest of this process; the same command retries it.
        """
        scores = np.full((len(self.trials), len(self.design.seeds)), math.nan)
        for row, trial in zip(scores, self.trials, strict=True):
            if not trial.planned:
                row[0] = -math.inf
            for place, entry in enumerate(trial.planned[: len(row)]):
                row[place] = self._score(entry.cell)
                if math.isnan(row[place]):  # later seeds may have been run for another reason; they wait for their turn
                    break
        return scores

    def diverged(self, trial: Trial) -> bool:
        """Whether a run of a trial did not learn."""
        found = (self._results(entry.cell) for entry in trial.planned)
        return any(results is not None and results["outcome"] == "diverged" for results in found)

    def cells(self, running: list[Planned]) -> list[Cell]:
        """The cells of the plan, trial by trial: those that have been run and those about to be run."""
        counts, seeds = seeds_run(self.scores()), len(self.design.seeds)
        about = {id(entry) for entry in running}
        return [
            replace(entry.cell, message=self.failed.get(entry.cell.run, ""))
            for trial, count in zip(self.trials, counts, strict=True)
            for place, entry in enumerate(trial.planned)
            if place < count or id(entry) in about or (place >= seeds and self._begun(entry.cell))
        ]

    def best(self) -> Trial | None:
        """The leading trial, None if no trial has a result."""
        found = leader(self.scores()) if self.trials else None
        return None if found is None else self.trials[found]

    def _begun(self, cell: Cell) -> bool:
        return bool(RunDirectory(self.outputs / cell.run).state())

    def _score(self, cell: Cell) -> float:
        results = self._results(cell)
        if results is None:
            return -math.inf if cell.run in self.failed else math.nan
        if results["outcome"] != "finished":
            return -math.inf
        metric = str(self.design.search.metric)
        if metric not in results["metrics"]:
            known = [name for name in results["metrics"] if name.startswith("val/")]
            raise UserError(
                f"sweep.search.metric={metric}: {cell.run} has no such metric", f"It has {', '.join(known) or 'none'}"
            )
        if not self._known:  # check at the first run, not the last, that the report's metric exists
            self._known = metric_of_test(self.design.search.model_dump(), results["metrics"])
        value = results["metrics"][metric]
        return -math.inf if value is None else self.design.sign * float(value)

    def _results(self, cell: Cell) -> dict[str, Any] | None:
        """The results of a finished run, read once; None if it is not finished."""
        if cell.run not in self._finished:
            results = RunDirectory(self.outputs / cell.run).results()
            if results is None:
                return None
            self._finished[cell.run] = results
        return self._finished[cell.run]
