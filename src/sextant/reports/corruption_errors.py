"""Errors of the arms of a sweep under a published set of corruptions, over seeds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sextant.chapters.classification.report import BASELINES, SEVERITIES
from sextant.evaluation import BENCHMARK_15, CorruptionBaseline, CorruptionErrors, mean_interval, share_interval
from sextant.kit.measure import SharedSet
from sextant.reports.results import SweepResults


@dataclass(frozen=True)
class OverSeeds:
    """Mean, standard deviation and 95 % interval of the mean over converged runs; nan for too few runs."""

    mean: float
    spread: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "OverSeeds":
        """Summarise one value per run."""
        numbers = np.asarray(values, float)
        mean = float(numbers.mean()) if len(numbers) else float("nan")
        spread = float(numbers.std(ddof=1)) if len(numbers) > 1 else float("nan")
        return cls(mean, spread, *mean_interval(numbers))

    @classmethod
    def of_shares(cls, values: Sequence[float]) -> "OverSeeds":
        """Summarise one share per run, with an interval that stays within [0, 1]."""
        found = cls.of(values)
        low, high = share_interval(np.asarray(values, float))
        return cls(found.mean, found.spread, low, high)


@dataclass(frozen=True)
class ArmErrors:
    """Errors of one arm in one setting, as shares in [0, 1], with one :class:`CorruptionErrors` per converged run."""

    setting: str
    arm: str
    runs: Sequence[CorruptionErrors]

    def mean(self) -> CorruptionErrors:
        """The errors averaged over runs; raises ``ValueError`` without any."""
        if not self.runs:
            raise ValueError(f"{self.setting}, {self.arm}: no run converged")
        severities = {
            name: tuple(float(value) for value in np.mean([run.severities[name] for run in self.runs], axis=0))
            for name in self.runs[0].severities
        }
        return CorruptionErrors(float(np.mean([run.clean for run in self.runs])), severities)


def arm_errors(results: SweepResults) -> list[ArmErrors]:
    """Errors of every arm in every setting, in the order of the plan."""
    found = []
    for setting in results.settings:
        for arm in results.arms_of(setting):
            cells = [cell for cell in results.of(setting, arm) if cell.outcome == "finished"]
            found.append(ArmErrors(setting, arm, [cell.errors for cell in cells if cell.errors is not None]))
    return found


def baseline_of(shared: SharedSet) -> CorruptionBaseline | None:
    """The baseline of corruption errors; needs one set with a baseline, and all five severities of every corruption."""
    baseline = BASELINES.get(shared.key or "")
    whole = all(len(levels) == SEVERITIES for levels in shared.severities.values())
    return baseline if baseline is not None and whole and set(shared.severities) <= set(baseline.errors) else None


def scored_sets(shared: SharedSet) -> dict[str, tuple[str, ...]]:
    """The sets of corruptions over which mCE is averaged, by column heading."""
    everything = tuple(shared.severities)
    sets = {f"of {len(everything)}": everything}
    if set(BENCHMARK_15) < set(everything):
        sets["of 15"] = BENCHMARK_15
    return sets
