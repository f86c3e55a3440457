"""What the trials of a search found, as its report counts it."""

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
    """A trial, by its runs at the seeds of the search.

    Attributes:
        number: in the order in which trials were asked for.
        setting: the value of each key.
        values: of the validation metric, in the order of the seeds.
        tested: the same runs by the metric of the test split.
        state: ``raced out`` has fewer seeds than there are, since it could not beat the best any more.
        why: it has no result.
    """

    number: int
    setting: Mapping[str, str]
    values: tuple[float, ...]
    tested: tuple[float, ...]
    state: State
    why: str = ""

    @property
    def mean(self) -> float:
        """Of the validation metric, nan without a result."""
        return float(np.mean(self.values)) if self.values else math.nan


@dataclass(frozen=True)
class SearchResults:
    """A search.

    Attributes:
        search: the node of the config, with its defaults filled in.
        seeds: that trials are run at.
        trials: all of them, by number.
        winner: the trial that leads; None if none has a result.
        fresh: validation and test metric of the winner at each fresh seed that has been run.
        fresh_missing: how many fresh seeds of the winner have no result.
        winners_tested: how many trials have been tested at fresh seeds, now or before the search went on.
        importances: share of each key.
        test_metric: that is reported.
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
        """Whether more is better."""
        return bool(self.search["direction"] == "maximize")

    @property
    def extreme(self) -> str:
        """What is searched for."""
        return "maximum" if self.maximize else "minimum"

    @property
    def runs(self) -> int:
        """How many runs the trials had."""
        return sum(len(trial.values) for trial in self.trials)


def search_results(results: SweepResults) -> SearchResults:
    """Read a search out of the results of its cells.

    Raises:
        UserError: its folder lacks what it found, or its runs have no such test metric.
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
    """The trial that leads by what its runs have found so far, which needs no search that has ended.

    Returns:
        Its first run, the mean of the validation metric, and over how many seeds; None while no trial has a result.
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
    """The metric that is reported of the test split: the counterpart of the validation metric unless one is named.

    Args:
        search: the node of the config.
        metrics: of a finished run.

    Raises:
        UserError: the run has no such metric, or several that may be meant.
    """
    test = [name for name in metrics if name.startswith("test/")]
    given, usual = search["test_metric"], search["metric"].replace("val/", "test/", 1)
    wanted = [given] if given else [usual, f"{usual}/clean"]
    parts = [] if given else [name for name in test if name.startswith(f"{usual}/")]
    found = next((name for name in wanted if name in test), parts[0] if len(parts) == 1 else None)
    if found is None:
        offered = parts or sorted(test, key=lambda name: name.count("/"))  # those of all conditions first
        raise UserError(
            f"sweep.search.test_metric={wanted[0]}: the runs have no such metric",
            f"Name one with sweep.search.test_metric=: {', '.join(offered[:12]) or 'they have none'}",
        )
    return found
