"""The results of the trials of a search."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from sextant.atomic_files import read_json
from sextant.errors import UserError
from sextant.evaluation.racing import leader
from sextant.reports.results import CellResult, SweepResults

State = Literal["all seeds", "raced out", "diverged", "failed", "unfinished"]


@dataclass(frozen=True)
class TrialResult:
    """The result of a trial over its runs at the seeds of the search.

    Attributes:
        number: number of the trial, in the order of creation.
        setting: the value of each key.
        values: validation metric of its runs, in the order of the seeds.
        tested: test metric of the same runs.
        state: how the trial stands; ``raced out`` has fewer seeds than planned, since it could no longer beat the best.
        why: why it has no result.
    """

    number: int
    setting: Mapping[str, str]
    values: tuple[float, ...]
    tested: tuple[float, ...]
    state: State
    why: str = ""

    @property
    def mean(self) -> float:
        """The mean of the validation metric; nan without a result."""
        return float(np.mean(self.values)) if self.values else math.nan


@dataclass(frozen=True)
class SearchResults:
    """The results of a search.

    Attributes:
        search: the node of the config, with its defaults filled in.
        seeds: seeds at which trials are run.
        trials: all trials, by number.
        winner: the leading trial; None if no trial has a result.
        fresh: validation and test metric of the winner at each fresh seed that has been run.
        fresh_missing: number of fresh seeds at which the winner has no result.
        winners_tested: number of trials tested at fresh seeds, including winners of earlier stages of the search.
        importances: importance of each key.
        test_metric: the test metric that is reported.
    """

    search: Mapping[str, Any]
    seeds: tuple[int, ...]
    trials: tuple[TrialResult, ...]
    winner: TrialResult | None
    fresh: tuple[tuple[float, float], ...]
    fresh_missing: int
    winners_tested: int
    importances: Mapping[str, float]
    test_metric: str

    @property
    def maximize(self) -> bool:
        """Whether higher is better."""
        return bool(self.search["direction"] == "maximize")

    @property
    def extreme(self) -> str:
        """``maximum`` or ``minimum``, as the search requires."""
        return "maximum" if self.maximize else "minimum"

    @property
    def runs(self) -> int:
        """The number of runs of all trials."""
        return sum(len(trial.values) for trial in self.trials)


def search_results(results: SweepResults) -> SearchResults:
    """Read the results of a search from those of its cells.

    Raises:
        UserError: the search has not ended, or its runs do not have the test metric.
    """
    search, seeds = results.plan.definition["search"], tuple(results.plan.definition["seeds"])
    found = read_json(results.directory / "search.json")
    if not isinstance(found, Mapping):
        raise UserError(f"{results.directory}/search.json is missing: the search has not ended", "Start it again.")
    metrics = next((cell.metrics for cell in results.cells if cell.outcome == "finished"), None)
    test_metric = "test" if metrics is None else metric_of_test(search, metrics)
    by_arm: dict[str, list[CellResult]] = {}
    for cell in results.cells:
        by_arm.setdefault(cell.cell.arm, []).append(cell)
    trials = []
    for told in found["trials"]:
        cells = by_arm.get(f"trial {told['number']}", [])
        trials.append(_trial(told, [c for c in cells if c.cell.seed in seeds], search, len(seeds), test_metric))
    winner = found["winner"]
    fresh = {arm: [c for c in cells if c.cell.seed not in seeds] for arm, cells in by_arm.items()}
    tested = [_both(cell, search, test_metric) for cell in fresh.get(f"trial {winner}", [])]
    kept = tuple(pair for pair in tested if not any(map(math.isnan, pair)))
    return SearchResults(
        search=search,
        seeds=seeds,
        trials=tuple(trials),
        winner=None if winner is None else trials[winner],
        fresh=kept,
        fresh_missing=0 if winner is None else len(search["fresh_seeds"]) - len(kept),
        winners_tested=sum(bool(cells) for cells in fresh.values()),
        importances=found["importances"],
        test_metric=test_metric,
    )


def leading_trial(results: SweepResults) -> tuple[CellResult, float, int] | None:
    """The trial that leads according to the runs so far; the search need not have ended.

    Returns:
        Its first run, its mean validation metric, and the number of seeds; None while no trial has a result.
    """
    search, seeds = results.plan.definition["search"], list(results.plan.definition["seeds"])
    sign = 1 if search["direction"] == "maximize" else -1
    first: dict[str, CellResult] = {}
    for cell in results.cells:
        first.setdefault(cell.cell.arm, cell)
    scores, rows = np.full((len(first), len(seeds)), math.nan), {arm: row for row, arm in enumerate(first)}
    for cell in results.cells:
        if cell.cell.seed in seeds and cell.outcome != "missing":
            known = cell.outcome == "finished" and search["metric"] in cell.metrics
            value = sign * cell.metrics[search["metric"]] if known else -math.inf
            scores[rows[cell.cell.arm], seeds.index(cell.cell.seed)] = value
    found = leader(scores)
    if found is None:
        return None
    values = scores[found][~np.isnan(scores[found])]
    return list(first.values())[found], sign * float(values.mean()), len(values)


def _trial(
    told: Mapping[str, Any], cells: list[CellResult], search: Mapping[str, Any], seeds: int, test_metric: str
) -> TrialResult:
    setting, number = told["setting"], int(told["number"])
    outcomes = {cell.outcome for cell in cells}
    pairs = [_both(cell, search, test_metric) for cell in cells if cell.outcome == "finished"]
    bad: State | None = "diverged" if "diverged" in outcomes else "failed" if "failed" in outcomes else None
    if bad is not None or told["problem"] or any(math.isnan(value) for value, _ in pairs):
        which = ", ".join(f"seed {cell.cell.seed}" for cell in cells if cell.outcome == bad)
        why = told["problem"] or next((cell.cell.message for cell in cells if cell.cell.message), which)
        return TrialResult(number, setting, (), (), bad or "failed", why)
    values, tests = tuple(value for value, _ in pairs), tuple(test for _, test in pairs)
    state: State = "unfinished" if not values else "all seeds" if len(values) == seeds else "raced out"
    return TrialResult(number, setting, values, tests, state)


def _both(cell: CellResult, search: Mapping[str, Any], test_metric: str) -> tuple[float, float]:
    return cell.metrics.get(search["metric"], math.nan), cell.metrics.get(test_metric, math.nan)


def metric_of_test(search: Mapping[str, Any], metrics: Iterable[str]) -> str:
    """The test metric to report: the counterpart of the validation metric unless one is named.

    Args:
        search: the node of the config.
        metrics: metrics of a finished run.

    Raises:
        UserError: the run has no such metric, or several candidates.
    """
    test = [name for name in metrics if name.startswith("test/")]
    given, usual = search["test_metric"], search["metric"].replace("val/", "test/", 1)
    wanted = [given] if given else [usual, f"{usual}/clean"]
    parts = [] if given else [name for name in test if name.startswith(f"{usual}/")]
    found = next((name for name in wanted if name in test), parts[0] if len(parts) == 1 else None)
    if found is None:
        offered = parts or sorted(test, key=lambda name: name.count("/"))  # metrics over all conditions first
        raise UserError(
            f"sweep.search.test_metric={wanted[0]}: the runs have no such metric",
            f"Name one with sweep.search.test_metric=: {', '.join(offered[:12]) or 'they have none'}",
        )
    return found
