"""The part of a report that compares several arms with one control: effects against costs, or over a grid."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from sextant.evaluation import holm
from sextant.figures.effects import CostPoint, effect_map, error_against_cost
from sextant.reports.contrasts import ContrastRow, Sides, named_contrasts, noise_floor
from sextant.reports.cost_report import multiplications
from sextant.reports.factor_report import numeric_factors
from sextant.reports.results import SweepResults
from sextant.reports.section import Section, Summary
from sextant.tables import TextTable, number, p_text, with_interval

#: least number of arms with the same control for which the section is written
LEAST_ARMS = 3
LEVEL = 0.05


@dataclass(frozen=True)
class ArmEffect:
    """One arm against the control in one setting under one condition.

    Attributes:
        row: the contrast.
        arm: the treatment.
        p: of the paired t test, corrected by Holm over the arms of the family; nan if treatment and control are the
            same runs.
    """

    row: ContrastRow
    arm: str
    p: float

    @property
    def certain(self) -> bool:
        """Whether the corrected p is below 0.05."""
        return self.p < LEVEL


def effects_section(results: SweepResults, rows: Sequence[ContrastRow], summaries: Sequence[Summary]) -> Section:
    """A table of the arms' effects, and a figure; empty unless several arms of a published set share their control.

    A family of Holm's correction is all arms under one condition in one setting, or in all settings of a grid: those
    that differ in a numeric factor alone.
    """
    sides = _compared(results)
    if results.shared is None or len(sides) < LEAST_ARMS:
        return Section()
    effects = arm_effects(results, rows, sides)
    grid = numeric_factors(results)
    figures = []
    if not grid:
        figures = list(_costs(results, effects, summaries, sides))
    elif len(grid) == 1:
        figures = list(_maps(results, effects, grid[0]))
    return Section(
        "\n".join(
            [
                "## Every arm beside its cost\n",
                _legend(results, sides, bool(grid)),
                *(f"![effects of the arms]({name}.png)\n" for name, _ in figures),
                effects_table(results, effects).markdown(),
            ]
        ),
        {"effects.csv": _csv_table(results, effects).csv()},
        figures,
    )


def arm_effects(results: SweepResults, rows: Sequence[ContrastRow], sides: dict[str, Sides]) -> list[ArmEffect]:
    """The effects under ``clean``, ``corrupted`` and what is beside the set, in the order of the plan."""
    assert results.shared is not None
    wanted = [name for name in results.conditions if name in ("clean", "corrupted", *results.shared.beside)]
    found: list[ArmEffect] = []
    for family in _families(results):
        for condition in wanted:
            members = [r for r in rows if r.contrast in sides and r.setting in family and r.condition == condition]
            effects = [ArmEffect(row, sides[row.contrast]["treatment"], _p(results, row, sides)) for row in members]
            adjusted = holm([effect.p for effect in effects])
            found += [ArmEffect(e.row, e.arm, p) for e, p in zip(effects, adjusted, strict=True) if e.row.paired]
    return found


def effects_table(results: SweepResults, effects: Sequence[ArmEffect]) -> TextTable:
    """One row per setting and arm: cost, and under each condition the difference, its interval and p."""
    conditions = list(dict.fromkeys(effect.row.condition for effect in effects))
    columns = [
        "setting",
        "arm",
        "pairs",
        "multiplications",
        *(f"{c}{what}" for c in conditions for what in ("", ", p")),
    ]
    found = {(e.row.setting, e.arm, e.row.condition): e for e in effects}
    body = []
    for setting, arm in dict.fromkeys((effect.row.setting, effect.arm) for effect in effects):
        each = [found[setting, arm, condition] for condition in conditions]
        pairs = f"{each[0].row.paired.seeds if each[0].row.paired else 0}{'†' if each[0].row.exploratory else ''}"
        cost, digits = number(multiplications(results, setting, arm), 2), results.measure.digits
        told = [text for e in each for text in (with_interval(e.row.paired, digits, sign=True), p_text(e.p))]
        body.append([setting, arm, pairs, f"{cost}×", *told])
    return TextTable(columns, body)


def _compared(results: SweepResults) -> dict[str, Sides]:
    """The contrasts, except the noise floor, of the control that most of them share."""
    named = {name: sides for name, sides in named_contrasts(results).items() if name != noise_floor(results)}
    controls = [sides["control"] for sides in named.values()]
    usual = max(dict.fromkeys(controls), key=controls.count, default=None)
    return {name: sides for name, sides in named.items() if sides["control"] == usual}


def _families(results: SweepResults) -> list[list[str]]:
    numeric = numeric_factors(results)
    families: dict[tuple[str, ...], list[str]] = {}
    for setting in results.settings:
        factors = next(result.cell.factors for result in results.cells if result.cell.setting == setting)
        families.setdefault(tuple(v for key, v in factors.items() if key not in numeric), []).append(setting)
    return list(families.values())


def _p(results: SweepResults, row: ContrastRow, sides: dict[str, Sides]) -> float:
    runs = [{cell.cell.run for cell in results.of(row.setting, arm)} for arm in sides[row.contrast].values()]
    return float("nan") if row.paired is None or runs[0] == runs[1] else row.paired.t_p_value


def _legend(results: SweepResults, sides: dict[str, Sides], grid: bool) -> str:
    control = next(iter(sides.values()))["control"]
    family = "all settings and arms" if grid else "the arms of a setting"
    return (
        f"{results.measure.difference.capitalize()} from *{control}*, paired by seed, with 95 % t intervals; "
        f"{results.measure.better} is better. p is of the paired t test, corrected by Holm over {family} under one "
        f"condition; – where both are the same runs. Multiplications are relative to those of *{control}*, with the "
        "pull as a second convolution. † fewer pairs than a claim needs: exploratory.\n"
    )


def _costs(
    results: SweepResults, effects: Sequence[ArmEffect], summaries: Sequence[Summary], sides: dict[str, Sides]
) -> Iterator[tuple[str, Figure]]:
    control = next(iter(sides.values()))["control"]
    certain = {(e.row.setting, e.arm, e.row.condition): e.certain for e in effects}
    arms = (control, *(each["treatment"] for each in sides.values()))
    conditions = dict.fromkeys(effect.row.condition for effect in effects)
    found = {(s.setting, s.arm, s.condition): s for s in summaries if s.seeds}
    panels = {
        (_title(results, condition), setting): [
            CostPoint(
                arm,
                multiplications(results, setting, arm),
                (cell := found[setting, arm, condition]).mean,
                cell.low,
                cell.high,
                certain.get((setting, arm, condition), False),
            )
            for arm in arms
            if (setting, arm, condition) in found
        ]
        for condition in conditions
        for setting in results.settings
        if (setting, control, condition) in found
    }
    if panels:
        filled = f"Filled: differs from {control}, p < 0.05 (paired t, Holm over arms)."
        told = f"Bars: 95 % over {results.replicate}. {filled}"
        cost = f"multiplications, relative to {control}"
        yield (
            "error_against_cost",
            error_against_cost(panels, cost=cost, quantity=f"error ({results.measure.unit})", told=told),
        )


def _maps(results: SweepResults, effects: Sequence[ArmEffect], factor: str) -> Iterator[tuple[str, Figure]]:
    level_of = {result.cell.setting: float(result.cell.factors[factor]) for result in results.cells}
    for place, family in enumerate(_families(results)):
        members = [effect for effect in effects if effect.row.setting in family]
        arms = list(dict.fromkeys(effect.arm for effect in members))
        levels = sorted({level_of[effect.row.setting] for effect in members})
        panels, texts = {}, {}
        for condition in dict.fromkeys(effect.row.condition for effect in members):
            values, told = np.full((len(arms), len(levels)), np.nan), [[""] * len(levels) for _ in arms]
            for effect in members:
                if effect.row.condition == condition and effect.row.paired is not None:
                    row, column = arms.index(effect.arm), levels.index(level_of[effect.row.setting])
                    values[row, column] = effect.row.paired.mean
                    mark = " *" if effect.certain else ""
                    text = with_interval(effect.row.paired, results.measure.digits, sign=True)
                    told[row][column] = text.replace(" [", f"{mark}\n[", 1)
            panels[_title(results, condition)], texts[_title(results, condition)] = values, told
        if panels:
            figure = effect_map(
                panels,
                texts,
                rows=arms,
                columns=[f"{level:g}" for level in levels],
                factor=factor,
                better=results.measure.better,
                quantity=f"{results.measure.difference}, [95 % over {results.replicate}], * p < {LEVEL} after Holm",
            )
            yield f"effect_map{f'_{place}' if place else ''}", figure


def _title(results: SweepResults, condition: str) -> str:
    assert results.shared is not None
    return {"corrupted": f"mean of {len(results.shared.severities)} corruptions"}.get(
        condition, f"{condition} noise" if condition in results.shared.beside else condition
    )


def _csv_table(results: SweepResults, effects: Sequence[ArmEffect]) -> TextTable:
    columns = ["setting", "arm", "condition", "pairs", "cost_ratio", "difference", "low", "high", "t_p_value", "p_holm"]
    body = []
    for e in effects:
        assert e.row.paired is not None
        values = [
            multiplications(results, e.row.setting, e.arm),
            e.row.paired.mean,
            e.row.paired.low,
            e.row.paired.high,
        ]
        values += [e.row.paired.t_p_value, e.p]
        body.append([e.row.setting, e.arm, e.row.condition, str(e.row.paired.seeds), *map(str, values)])
    return TextTable(columns, body)
