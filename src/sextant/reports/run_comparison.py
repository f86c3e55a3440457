"""Differences between two runs, and whether their metrics differ by more than seeds alone explain."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from sextant.moved import TARGET, present_name
from sextant.runs.directory import RunDirectory, all_runs
from sextant.tables import NOTHING

#: entries of a run's state, other than its config, that can differ
SOURCES = ("code", "data")


@dataclass(frozen=True)
class MetricDifference:
    """One metric of two runs.

    Attributes:
        name: name of the metric.
        first, second: its values.
        reach: largest difference expected 95 times in 100 between runs that differ only in their seeds; nan if there is
            no run of the same config with another seed.
        seeds: number of runs that the reach rests on.
    """

    name: str
    first: float
    second: float
    reach: float
    seeds: int

    @property
    def beyond_seeds(self) -> bool | None:
        """Whether the difference exceeds that due to seeds; None where that is unknown."""
        return None if math.isnan(self.reach) else abs(self.second - self.first) > self.reach


@dataclass(frozen=True)
class RunComparison:
    """What differs between two runs, by name with both values; ``metrics`` are those that both runs have."""

    config: dict[str, tuple[str, str]]
    origin: dict[str, tuple[str, str]]
    metrics: list[MetricDifference]


def compare_runs(first: RunDirectory, second: RunDirectory, outputs: Path) -> RunComparison:
    """Compare two runs; the spread over seeds is estimated from the runs in ``outputs`` with either config.

    With s the standard deviation over seeds, pooled over both configs with ν degrees of freedom, two runs that differ
    only in their seeds are within ``t_ν sqrt(2) s`` of each other 95 times in 100.
    """
    states = first.state(), second.state()
    groups = [metrics_alike(state, outputs) for state in states]
    if states[0].get("digest") == states[1].get("digest"):
        groups = groups[:1]
    values = [_metrics(run) for run in (first, second)]
    shared = [name for name in values[0] if name in values[1]]
    metrics = [MetricDifference(name, values[0][name], values[1][name], *_reach(name, groups)) for name in shared]
    return RunComparison(
        _different(*(_params(state) for state in states)),
        _different(*(_origin(state) for state in states)),
        metrics,
    )


def _params(state: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters of a run, its parts by their present import paths."""
    params = dict(state.get("params", {}))
    return {key: present_name(str(of)) if key.endswith(TARGET) else of for key, of in params.items()}


def _reach(name: str, groups: Sequence[Sequence[Mapping[str, float]]]) -> tuple[float, int]:
    """The half-width of the range of differences due to seeds, and the number of runs it rests on."""
    samples = [np.array([run[name] for run in group if name in run]) for group in groups]
    samples = [values for values in samples if len(values) > 1]
    freedom = sum(len(values) - 1 for values in samples)
    if not freedom:
        return float("nan"), 0
    variance = sum(float(((values - values.mean()) ** 2).sum()) for values in samples) / freedom
    return float(stats.t.ppf(0.975, freedom)) * math.sqrt(2 * variance), sum(map(len, samples))


def metrics_alike(state: Mapping[str, Any], outputs: Path) -> list[Mapping[str, float]]:
    """Metrics of all finished runs of the same config, code and data, one per seed."""
    keys = ("task", "digest", "code", "data")
    found: dict[Any, Mapping[str, float]] = {}
    for run in all_runs(outputs):
        other = run.state()
        if all(other.get(key) == state.get(key) for key in keys) and run.results() is not None:
            found.setdefault(other.get("seed"), _metrics(run))
    return list(found.values())


def _metrics(run: RunDirectory) -> dict[str, float]:
    metrics = (run.results() or {}).get("metrics") or {}
    return {name: float(value) for name, value in metrics.items() if isinstance(value, int | float)}


def _origin(state: Mapping[str, Any]) -> dict[str, Any]:
    found = {name: str(state.get(name, NOTHING))[:12] for name in SOURCES}
    origin = state.get("provenance", {})
    for kind in ("git", "versions", "hardware"):
        found |= {f"{kind}.{name}": value for name, value in (origin.get(kind) or {}).items()}
    return found


def _different(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, tuple[str, str]]:
    names = dict.fromkeys([*first, *second])
    both = {name: (str(first.get(name, NOTHING)), str(second.get(name, NOTHING))) for name in names}
    return {name: pair for name, pair in both.items() if pair[0] != pair[1]}
