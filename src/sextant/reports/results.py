"""The results of the runs of a sweep."""

import math
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import yaml
from jaxtyping import Float
from numpy import ndarray

from sextant.errors import UserError
from sextant.evaluation import CorruptionErrors
from sextant.evaluation.verdict import Replicate
from sextant.kit.measure import ACCURACY, Measure, RunValues, SharedSet, conditions_in, require_answers, shared_set
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import Cell, SweepPlan, read_plan
from sextant.tables import counted

Outcome = Literal["finished", "diverged", "failed", "missing"]
Content = TypeVar("Content")
#: derives values from the arrays of a run; see ``sextant.kit.chapter.Chapter.measured``
Measured = Callable[[Mapping[str, ndarray], SharedSet | None, str | None], RunValues]
#: relative tolerance between a metric, which was summed in float32, and its value from the arrays
ROUNDING = 1e-4


@dataclass(frozen=True)
class Training:
    """How a run was trained, as far as recorded.

    Attributes:
        stopped: whether a loss that is not a number ended it, before it could be tested.
        max_epochs: the most epochs that its config allows.
        batch_size: number of examples a step.
        rate: learning rate.
        epochs: epochs that it was trained for.
        steps: steps that it was trained for.
    """

    stopped: bool
    max_epochs: int | None = None
    batch_size: int | None = None
    rate: float | None = None
    epochs: int | None = None
    steps: int | None = None

    @classmethod
    def of(cls, run: RunDirectory) -> "Training":
        """The training of a run, from its directory."""
        try:
            config = yaml.safe_load(run.config.read_text("utf-8"))
        except (OSError, yaml.YAMLError):
            config = None
        config = config if isinstance(config, dict) else {}
        trainer, results = config.get("trainer") or {}, run.results() or {}
        rate = (config.get("optimizer") or {}).get("lr")
        of_config = (trainer.get("max_epochs"), trainer.get("batch_size"), rate)
        return cls(not run.arrays.exists(), *of_config, results.get("epochs"), results.get("steps"))


@dataclass(frozen=True)
class CellResult:
    """One planned run and its result.

    Attributes:
        cell: the planned cell.
        outcome: the run's outcome; ``missing`` means that it has not run or was interrupted.
        values: for each condition, the value of each test image; empty unless finished or diverged.
        seconds: training time in seconds.
        parameters: number of parameters of the model.
        measure: the measure of the values.
        errors: errors by corruption and severity, for a run tested under a published set.
        cost: cost of the network from the run's ``metrics.json``; empty if it has none.
        metrics: all finite metrics of the run, by name.
        started: when the run was first started, in seconds since 1970; nan if its record does not say.
        headline: what the headline figure of a run under corruptions is; see :mod:`sextant.evaluation.headline`.
        training: how a run that diverged was trained; None for others.
        code, data: hashes of the code and of the data that it was made with; None if its record does not say.
    """

    cell: Cell
    outcome: Outcome
    values: dict[str, Float[ndarray, "images"]]
    seconds: float = float("nan")
    parameters: int = 0
    measure: Measure = ACCURACY
    errors: CorruptionErrors | None = None
    cost: Mapping[str, Any] = field(default_factory=dict)
    metrics: Mapping[str, float] = field(default_factory=dict)
    started: float = math.nan
    headline: Mapping[str, Any] = field(default_factory=dict)
    training: Training | None = None
    code: str | None = None
    data: str | None = None

    def value(self, condition: str) -> float:
        """The measure of this run under a condition."""
        return self.measure.of(self.values[condition])


@dataclass(frozen=True)
class SweepResults:
    """A sweep's plan and the result of every cell.

    Attributes:
        shared: the conditions of a published set that all tested runs share; None if they were not tested under one.
        configs: configs of runs by setting and arm, if its cells were stored apart from the runs.
    """

    plan: SweepPlan
    directory: Path
    cells: list[CellResult]
    shared: SharedSet | None = None
    configs: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def conditions(self) -> list[str]:
        """The keys of the conditions that all tested runs share, in the order of the test."""
        tested = [cell.values for cell in self.cells if cell.values]
        return [key for key in tested[0] if all(key in values for values in tested)] if tested else []

    @property
    def measure(self) -> Measure:
        """The measure of the runs."""
        return next((cell.measure for cell in self.cells if cell.values), ACCURACY)

    @property
    def settings(self) -> list[str]:
        """The factor combinations, in the order of the plan."""
        return list(dict.fromkeys(result.cell.setting for result in self.cells))

    @property
    def arms(self) -> list[str]:
        """The compared arms, in the order of the plan."""
        return list(dict.fromkeys(result.cell.arm for result in self.cells))

    @property
    def learnt(self) -> bool:
        """Whether any run converged, so that there is something to compare."""
        return self.count("finished") > 0

    @property
    def replicate(self) -> Replicate:
        """The unit of replication of a cell: ``worlds`` if the runs have any, otherwise ``seeds``."""
        return "worlds" if any(result.cell.world for result in self.cells) else "seeds"

    def arms_of(self, setting: str) -> list[str]:
        """The arms that are planned in a setting."""
        return list(dict.fromkeys(result.cell.arm for result in self.cells if result.cell.setting == setting))

    def of(self, setting: str, arm: str) -> list[CellResult]:
        """The replicates of one setting and arm, by pair: its runs, or the worlds with their runs averaged."""
        found = [r for r in self.cells if r.cell.setting == setting and r.cell.arm == arm]
        found = sorted(found, key=lambda result: result.cell.pair)
        if self.replicate == "seeds":
            return found
        worlds = list(dict.fromkeys(result.cell.world for result in self.cells))
        within = {world: [result for result in found if result.cell.world == world] for world in worlds}
        return [_averaged(runs, number) for number, runs in enumerate(within.values()) if runs]

    def published(self, setting: str, arm: str, condition: str) -> float:
        """The published figure of a cell in the unit of the measure; nan if the sweep names none."""
        named = self.plan.definition.get("published", {}).get(setting, {}).get(arm, {}).get(condition)
        return float("nan") if named is None else self.measure.of_published(float(named))

    def count(self, outcome: Outcome) -> int:
        """The number of cells with this outcome."""
        return sum(result.outcome == outcome for result in self.cells)


def _averaged(runs: Sequence[CellResult], world: int) -> CellResult:
    """The runs of one world as one replicate, which is finished once all of them are.

    Runs in one world share its images and its layout, so they are not independent replicates. Their values are averaged
    before worlds are compared, so that a world counts once however many seeds it has.
    """
    cell = replace(runs[0].cell, pair=world)
    unfinished = next((run for run in runs if run.outcome != "finished"), None)
    if len(runs) == 1 or unfinished is not None:
        return replace(unfinished or runs[0], cell=cell)
    names = [name for name in runs[0].metrics if all(name in run.metrics for run in runs)]
    return replace(
        runs[0],
        cell=cell,
        values={key: _joined([run.values[key] for run in runs], runs[0].measure) for key in runs[0].values},
        seconds=float(np.mean([run.seconds for run in runs])),
        errors=None,  # by corruption: only single runs have them
        metrics={name: float(np.mean([run.metrics[name] for run in runs])) for name in names},
    )


def _joined(values: list[Float[ndarray, "images"]], measure: Measure) -> Float[ndarray, "images"]:
    """All items of the runs of a world, or the mean of their medians."""
    return np.concatenate(values) if measure.statistic == "mean" else np.array([np.mean([*map(measure.of, values)])])


def read_results(directory: Path, outputs: Path, measured: Callable[[str], Measured]) -> SweepResults:
    """Read every run of a sweep.

    Args:
        directory: directory of the sweep.
        outputs: folder that the runs of its plan are relative to.
        measured: gives the function that derives values from a run's arrays, by the run's task.

    Raises:
        UserError: the sweep's plan or a run's arrays are damaged, or no run is finished yet.
    """
    plan = read_plan(directory)
    runs = [RunDirectory(outputs / cell.run) for cell in plan.cells]
    tested = [run for run in runs if run.results() is not None and run.arrays.exists()]
    names = [_from_arrays(run, conditions_in) for run in tested]
    shared = shared_set([(run.results() or {}).get("protocol") for run in tested], names)
    arms = plan.definition.get("arms", {})
    reads = {name: arm.get("reads") for name, arm in arms.items()}
    cells = [
        _load(cell, run, shared, reads.get(cell.arm), measured) for cell, run in zip(plan.cells, runs, strict=True)
    ]
    if not any(result.values or result.outcome == "diverged" for result in cells):
        which = f"none of its {counted(len(cells), 'run')}"
        raise UserError(f"sweep {plan.name}: {which} is finished yet", "Run the sweep first.")
    return SweepResults(plan, directory, cells, shared)


def _load(
    cell: Cell,
    run: RunDirectory,
    shared: SharedSet | None,
    reads: str | None,
    measured: Callable[[str], Measured],
) -> CellResult:
    results = run.results()
    if results is None:
        failure = cell.message or run.state().get("failure")
        return CellResult(cell, "failed" if failure and failure != "interrupted" else "missing", {})
    training = Training.of(run) if results["outcome"] == "diverged" else None
    state = run.state()
    made: dict[str, Any] = {"code": state.get("code"), "data": state.get("data")}
    if training is not None and training.stopped:
        return CellResult(cell, results["outcome"], {}, training=training, **made)
    values_of = measured(run.path.parent.name)  # runs/<task>/<run>

    def values(arrays: Mapping[str, ndarray]) -> RunValues:
        if reads is not None:
            require_answers(arrays, reads)
        return values_of(arrays, shared, reads)

    found = _from_arrays(run, values)
    _require_own(run, found.metrics, results.get("metrics") or {})
    seconds = results["timing"]["fit_s"]  # JSON has no nan
    return CellResult(
        cell,
        results["outcome"],
        found.by_condition,
        seconds=float("nan") if seconds is None else seconds,
        parameters=results["parameters"],
        measure=found.measure,
        errors=found.errors,
        cost=results.get("cost") or {},
        metrics={name: value for name, value in (results.get("metrics") or {}).items() if value is not None},
        started=float(state.get("started") or math.nan),
        headline=results.get("headline") or {},
        training=training,
        **made,
    )


def _from_arrays(run: RunDirectory, read: Callable[[Mapping[str, ndarray]], Content]) -> Content:
    try:
        with np.load(run.arrays, allow_pickle=False) as arrays:
            return read(arrays)
    except (OSError, EOFError, ValueError, KeyError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise UserError(
            f"{run.arrays} cannot be read: {error}", f"Delete {run.path} and run the sweep again."
        ) from None


def _require_own(run: RunDirectory, found: Mapping[str, float], told: Mapping[str, Any]) -> None:
    """Raise a ``UserError`` if the arrays of a run contradict its metrics."""
    for name, value in found.items():
        said = told.get(name)
        if said is not None and not math.isclose(value, said, rel_tol=ROUNDING, abs_tol=1e-6):
            raise UserError(
                f"{run.arrays} is not what the run was tested on: it gives {name}={value:.6g}, "
                f"{run.metrics.name} says {said:.6g}",
                f"Delete {run.path} and run the sweep again.",
            )
