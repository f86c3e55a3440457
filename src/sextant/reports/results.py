"""What the runs of a sweep found."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from sextant.errors import UserError
from sextant.reports.measure import ACCURACY, Measure, measured
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import Cell, SweepPlan, read_plan

Outcome = Literal["finished", "diverged", "failed", "missing"]


@dataclass(frozen=True)
class CellResult:
    """One planned run and what became of it.

    Attributes:
        cell: the plan.
        outcome: ``missing`` has not run or was interrupted.
        values: for each condition, the value of each test image; empty unless finished or diverged.
        seconds: training time.
        parameters: of the model.
        measure: what the values are.
    """

    cell: Cell
    outcome: Outcome
    values: dict[str, Float[ndarray, "images"]]
    seconds: float = float("nan")
    parameters: int = 0
    measure: Measure = ACCURACY

    def value(self, condition: str) -> float:
        """The number of this run under a condition."""
        return self.measure.of(self.values[condition])


@dataclass(frozen=True)
class SweepResults:
    """A sweep's plan and the result of every cell."""

    plan: SweepPlan
    directory: Path
    cells: list[CellResult]

    @property
    def conditions(self) -> list[str]:
        """Keys of the conditions that every tested run shares, in the order of the test."""
        tested = [cell.values for cell in self.cells if cell.values]
        return [key for key in tested[0] if all(key in values for values in tested)] if tested else []

    @property
    def measure(self) -> Measure:
        """What the values of the runs are."""
        return next((cell.measure for cell in self.cells if cell.values), ACCURACY)

    @property
    def settings(self) -> list[str]:
        """The factor combinations, in the order of the plan."""
        return list(dict.fromkeys(result.cell.setting for result in self.cells))

    @property
    def arms(self) -> list[str]:
        """The compared arms, in the order of the plan."""
        return list(dict.fromkeys(result.cell.arm for result in self.cells))

    def of(self, setting: str, arm: str) -> list[CellResult]:
        """The cells of one setting and arm, by pair."""
        found = [r for r in self.cells if r.cell.setting == setting and r.cell.arm == arm]
        return sorted(found, key=lambda result: result.cell.pair)

    def count(self, outcome: Outcome) -> int:
        """How many cells ended so."""
        return sum(result.outcome == outcome for result in self.cells)


def load_results(directory: Path, outputs: Path) -> SweepResults:
    """Read every run of a sweep.

    Raises:
        UserError: the sweep's plan or a run's arrays are damaged, or no run is finished yet.
    """
    plan = read_plan(directory)
    cells = [_load(cell, RunDirectory(outputs / cell.run)) for cell in plan.cells]
    if not any(result.values for result in cells):
        raise UserError(f"sweep {plan.name}: none of its {len(cells)} runs is finished yet", "Run the sweep first.")
    return SweepResults(plan, directory, cells)


def _load(cell: Cell, run: RunDirectory) -> CellResult:
    results = run.results()
    if results is None:
        failure = cell.message or run.state().get("failure")
        return CellResult(cell, "failed" if failure and failure != "interrupted" else "missing", {})
    if not run.arrays.exists():  # stopped by a nan, and kept as what it is
        return CellResult(cell, results["outcome"], {})
    try:
        with np.load(run.arrays, allow_pickle=False) as arrays:
            measure, values = measured(arrays)
    except (OSError, ValueError, KeyError) as error:
        raise UserError(
            f"{run.arrays} cannot be read: {error}", f"Delete {run.path} and run the sweep again."
        ) from None
    return CellResult(cell, results["outcome"], values, results["timing"]["fit_s"], results["parameters"], measure)
