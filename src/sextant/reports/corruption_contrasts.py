"""Contrasts of a sweep by corruption: errors of paired runs under a published set."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from sextant.evaluation import (
    SEEDS_FOR_A_CLAIM,
    CorruptionDifferences,
    CorruptionErrors,
    PairedDifference,
    corruption_differences,
    mean_interval,
    share_interval,
)
from sextant.reports.contrasts import (
    Sides,
    converged_pairs,
    dropped_pairs,
    named_contrasts,
    noise_floor,
    settings_of,
)
from sextant.reports.results import CellResult, SweepResults


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


Errors = Mapping[str, Float[ndarray, "pairs"]]


@dataclass(frozen=True)
class CorruptionContrast:
    """One contrast in one setting; errors are shares in [0, 1], each the mean over a corruption's severities.

    Attributes:
        contrast: its name in the sweep.
        setting: the setting in which it was measured.
        sides: the arms, ``treatment`` and ``control``.
        is_floor: whether it is the sweep's noise floor.
        treatment: errors of the treatment by corruption, over pairs in which both runs converged.
        control: errors of the control over the same pairs.
        differences: treatment minus control over these pairs; None without any.
        floor: the same between the noise-floor arms; None without a floor or for the floor itself.
        dropped: number of planned pairs left out because a run diverged, failed or is missing.
    """

    contrast: str
    setting: str
    sides: Sides
    is_floor: bool
    treatment: Errors
    control: Errors
    differences: CorruptionDifferences | None
    floor: CorruptionDifferences | None
    dropped: int

    @property
    def title(self) -> str:
        """What is compared, for a heading."""
        return f"{self.sides['treatment']} minus {self.sides['control']}"

    @property
    def pairs(self) -> int:
        """The number of pairs in which both runs converged."""
        return len(next(iter(self.treatment.values())))

    @property
    def exploratory(self) -> bool:
        """Whether fewer pairs converged than a claim needs."""
        return self.pairs < SEEDS_FOR_A_CLAIM

    def error(self, side: Literal["treatment", "control"], corruption: str | None = None) -> float:
        """The mean error of one side over the pairs, under one corruption or averaged over all."""
        return float(_of(self.treatment if side == "treatment" else self.control, corruption).mean())

    def won_pairs(self, corruption: str | None = None) -> int:
        """The number of pairs in which the treatment has the lower error, under one corruption or averaged over all."""
        return int((_of(self.treatment, corruption) < _of(self.control, corruption)).sum())


def of_corruption(found: CorruptionDifferences | None, corruption: str | None) -> PairedDifference | None:
    """The difference under one corruption, or of the means over all corruptions."""
    if found is None:
        return None
    return found.mean if corruption is None else found.by_corruption[corruption]


def corruption_contrasts(results: SweepResults) -> list[CorruptionContrast]:
    """Every contrast in every setting; raises ``ValueError`` if the runs were not tested under a published set."""
    if results.shared is None:
        raise ValueError("the runs were not tested under a published set of corruptions")
    named = named_contrasts(results)
    floor = noise_floor(results)
    found = []
    for name, sides in named.items():
        for setting in settings_of(results, sides):
            treatment, control = _paired_errors(results, setting, sides)
            beside = named.get(floor) if name != floor else None
            found.append(
                CorruptionContrast(
                    contrast=name,
                    setting=setting,
                    sides=sides,
                    is_floor=name == floor,
                    treatment=treatment,
                    control=control,
                    differences=_differences(treatment, control),
                    floor=None if beside is None else _differences(*_paired_errors(results, setting, beside)),
                    dropped=dropped_pairs(results, setting, sides),
                )
            )
    return found


def _paired_errors(results: SweepResults, setting: str, sides: Sides) -> tuple[Errors, Errors]:
    pairs = converged_pairs(results, setting, sides)
    treatment, control = ([_by_corruption(pair[side]) for pair in pairs] for side in (0, 1))
    names = results.shared.severities if results.shared is not None else ()
    stacked = [{name: np.array([errors[name] for errors in arm]) for name in names} for arm in (treatment, control)]
    return stacked[0], stacked[1]


def _by_corruption(cell: CellResult) -> dict[str, float]:
    assert cell.errors is not None  # set for runs tested under a published set
    return cell.errors.by_corruption()


def _differences(treatment: Errors, control: Errors) -> CorruptionDifferences | None:
    if not len(next(iter(treatment.values()))):
        return None
    return corruption_differences(treatment, control)


def _of(errors: Errors, corruption: str | None) -> Float[ndarray, "pairs"]:
    return np.mean(list(errors.values()), axis=0) if corruption is None else errors[corruption]
