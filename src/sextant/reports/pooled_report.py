"""The part of a report that compares an arm with all runs of its control, unpaired."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sextant.evaluation import Sample, StratifiedDifference, holm, stratified_difference
from sextant.reports.contrasts import named_contrasts, noise_floor, settings_of
from sextant.reports.results import SweepResults
from sextant.reports.section import Section
from sextant.tables import NOTHING, TextTable, interval, number, p_text

#: name of the mean over settings
TOGETHER = "together"


@dataclass(frozen=True)
class PooledRow:
    """One arm against the pooled control in one setting, or in all together, under one condition.

    Attributes:
        contrast: name of the contrast.
        setting: name of the setting, or ``TOGETHER``.
        treatment, control: numbers of converged runs.
        difference: the difference; None where there are too few runs.
        p_holm: Welch's p, corrected for the conditions of one setting.
    """

    contrast: str
    setting: str
    condition: str
    treatment: int
    control: int
    difference: StratifiedDifference | None
    p_holm: float = math.nan


def pooled_section(results: SweepResults) -> Section:
    """A table for each contrast whose control is an arm of the noise floor; empty without one.

    The arms of the noise floor are the same network at different seeds, so the runs of both count as control runs.
    """
    rows = pooled_rows(results)
    parts = []
    for contrast in dict.fromkeys(row.contrast for row in rows):
        sides = named_contrasts(results)[contrast]
        parts += [
            f"## {contrast}, pooled control: {sides['treatment']} minus {' and '.join(_control_arms(results))}\n",
            _legend(results),
            pooled_table([row for row in rows if row.contrast == contrast], results.measure.digits).markdown(),
        ]
    return Section("\n".join(parts), {"pooled.csv": _csv_table(rows).csv()} if rows else {})


def pooled_rows(results: SweepResults) -> list[PooledRow]:
    """Every such contrast under every condition, in each setting with a noise floor and in all of them together."""
    arms = _control_arms(results)
    settings = _settings(results)
    rows: list[PooledRow] = []
    for name, sides in named_contrasts(results).items():
        if sides["control"] not in arms or sides["treatment"] in arms:
            continue
        samples = {
            (setting, condition): (
                _sample(results, setting, [sides["treatment"]], condition),
                _sample(results, setting, arms, condition),
            )
            for setting in settings
            for condition in results.conditions
        }
        families = {setting: [setting] for setting in settings}
        if len(families) > 1:
            families[TOGETHER] = settings
        for label, within in families.items():
            found = [
                _row(name, label, c, [samples[setting, c] for setting in within], results.measure.largest)
                for c in results.conditions
            ]
            adjusted = holm([math.nan if row.difference is None else row.difference.p_value for row in found])
            rows += [replace(row, p_holm=p) for row, p in zip(found, adjusted, strict=True)]
    return rows


def pooled_table(rows: Sequence[PooledRow], digits: int) -> TextTable:
    """One row per setting and condition."""
    body = []
    for row in rows:
        told = [NOTHING] * 3
        if (found := row.difference) is not None:
            told = [number(found.mean, digits, sign=True), interval(found.low, found.high, digits, sign=True)]
            told.append(p_text(found.p_value))
        body.append([row.setting, row.condition, str(row.treatment), str(row.control), *told, p_text(row.p_holm)])
    columns = ["setting", "condition", "runs", "control runs", "difference", "95 %", "p (Welch)", "p (Welch, Holm)"]
    return TextTable(columns, body)


def _csv_table(rows: Sequence[PooledRow]) -> TextTable:
    numbers = ("mean", "low", "high", "freedom", "p_value")
    body = [
        [row.contrast, row.setting, row.condition, str(row.treatment), str(row.control)]
        + [str(getattr(row.difference, name, "")) for name in numbers]
        + [str(row.p_holm)]
        for row in rows
    ]
    return TextTable(["contrast", "setting", "condition", "treatment", "control", *numbers, "p_holm"], body)


def _control_arms(results: SweepResults) -> list[str]:
    sides = named_contrasts(results).get(noise_floor(results))
    # runs in one world are no independent controls
    return [] if sides is None or results.replicate == "worlds" else [sides["control"], sides["treatment"]]


def _settings(results: SweepResults) -> list[str]:
    """The settings with both arms of the noise floor."""
    sides = named_contrasts(results).get(noise_floor(results))
    return [] if sides is None else settings_of(results, sides)


def _sample(results: SweepResults, setting: str, arms: Sequence[str], condition: str) -> Sample:
    cells = [cell for arm in arms for cell in results.of(setting, arm) if cell.outcome == "finished"]
    return Sample.of(np.array([cell.value(condition) for cell in cells], float))


def _row(
    contrast: str, label: str, condition: str, strata: Sequence[tuple[Sample, Sample]], largest: float
) -> PooledRow:
    treatment, control = (sum(pair[side].count for pair in strata) for side in (0, 1))
    return PooledRow(contrast, label, condition, treatment, control, stratified_difference(strata, largest=largest))


def _legend(results: SweepResults) -> str:
    text = (
        f"{results.measure.difference.capitalize()}; {results.measure.better} is better. The arms of the noise floor "
        "are the same network at different seeds, so all their converged runs are the control. Runs are not paired; "
        "those that diverged are left out. Intervals and p are of Welch's t test over runs, two-sided; Holm's "
        "family is the conditions of one setting."
    )
    if len(_settings(results)) > 1:
        text += (
            f" *{TOGETHER.capitalize()}* is the mean of the settings' differences, equally weighted, with the "
            "spread within each (Satterthwaite's degrees of freedom)."
        )
    return text + "\n"
