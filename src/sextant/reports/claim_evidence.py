"""Estimates for claims, from the tables of stored reports."""

import csv
import math
import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

import numpy as np
from scipy import stats

from sextant.config.schema.claims import ClaimPart
from sextant.errors import UserError
from sextant.evaluation.paired import spread_of
from sextant.evaluation.verdict import TAIL, Estimate, Replicate

#: value of the column ``seeds`` of ``recorded.csv`` for figures that are exact, whatever the seed
COUNTED = "counted"
#: table of what a constant, or the best of the methods that learn nothing, reaches in each setting and condition
BASELINES = "baselines.csv"
#: spread of replicates, relative to their mean, that is rounding alone
ALIKE = 1e-12
#: table of what each replicate of a recorded figure showed
REPLICATE_TABLE = "replicates.csv"
REPLICATES: Mapping[str, Replicate] = {each: each for each in get_args(Replicate)}
#: table of the value of every run of a sweep
SEEDS = "seeds.csv"
#: a comparison that has not been run
NOT_RUN = Estimate(math.nan, math.nan, 0, 0, run=False)
#: decimals to which differences are rounded
ROUNDING = 9
#: advice for a table that is missing or damaged
STORED = "It is stored with the sweep's report: sextant report sweep=<name>."


@dataclass(frozen=True)
class Row:
    """A row of a stored table.

    Attributes:
        place: its file and line, for messages.
        cells: values by column.
    """

    place: str
    cells: Mapping[str, str]

    def __getitem__(self, column: str) -> str:
        if column not in self.cells:
            raise UserError(f"{self.place}: there is no column {column}", f"Its columns: {', '.join(self.cells)}.")
        return self.cells[column]

    def number(self, column: str, least: float = -math.inf) -> float:
        """The finite number in a column."""
        try:
            value = float(self[column].replace(",", ""))
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and value >= least):
            asked = "a number" if least == -math.inf else f"a number from {least:g} up"
            raise UserError(f"{self.place}: {column}={self[column]} must be {asked}", STORED)
        return value

    def count(self, column: str) -> int:
        """The non-negative whole number in a column."""
        if not self[column].isdecimal():
            raise UserError(f"{self.place}: {column}={self[column]} must be a whole number from 0 up", STORED)
        return int(self[column])


@dataclass(frozen=True)
class Evidence:
    """An estimate, labelled with what it estimates."""

    label: str
    estimate: Estimate


def read_table(path: Path) -> list[Row]:
    """The rows of a stored table; of columns with the same name (``ratio`` in a table of costs) the first is read.

    Raises:
        UserError: the file does not exist, or it is not a table.
    """
    if not path.is_file():
        raise UserError(f"{path} is not there", STORED)
    try:
        with path.open(encoding="utf-8", newline="") as file:
            columns, *rows = csv.reader(file)
    except (ValueError, csv.Error):  # binary, or empty
        raise UserError(f"{path} is not a table of comma-separated values", STORED) from None
    found = []
    for line, row in enumerate(rows, start=2):
        if len(row) != len(columns):
            raise UserError(f"{path}, line {line}: {len(row)} values in {len(columns)} columns", STORED)
        found.append(Row(f"{path}, line {line}", dict(reversed(list(zip(columns, row, strict=True))))))
    return found


def evidence(
    path: Path, part: ClaimPart, arms: Mapping[str, Sequence[str]] | None = None, baselines: Path | None = None
) -> Iterator[Evidence]:
    """Yield an estimate for each name, setting and condition of a part, positive where it favours the claim.

    A contrast that a report was stored without is computed from its seeds; one with an arm that has no run there, or
    whose report is not stored at all, is :data:`NOT_RUN`; so are differences that an older report lacks.

    Args:
        path: the table of the part.
        part: the rows of the table; ``recorded`` has neither settings nor conditions, ``cost`` no conditions.
        arms: the two arms of each contrast, which are not compared unless both are better than a constant.
        baselines: table of the constants; nothing is asked of the arms without one.

    Raises:
        UserError: the table has no such row.
    """
    table, sign = part.table, -1.0 if part.direction == "down" else 1.0
    stored = path.is_file() or (table != "differences" and path.parent.is_dir())
    rows = read_table(path) if stored else []
    column = {"cells": "arm", "cost": "arm", "recorded": "name"}.get(table, "contrast")

    def row(**wanted: str) -> Row:
        found = next((row for row in rows if all(row[key] == value for key, value in wanted.items())), None)
        if found is None:
            told = " ".join(f"{key}={value}" for key, value in wanted.items())
            there = ", ".join(dict.fromkeys(row[column] for row in rows))
            raise UserError(f"{path} has no row {told}", f"Its {column}s: {there}.")
        return found

    def estimated(name: str, setting: str, condition: str) -> Estimate:
        if not stored:
            return NOT_RUN
        if table == "cost":
            ratio = row(arm=name, setting=setting).number(part.quantity)
            ratio /= row(arm=str(part.against), setting=setting).number(part.quantity)
            extra = round(sign * 100 * (ratio - 1), ROUNDING) + 0.0  # turns -0.0 into 0.0
            return Estimate(extra, 0.0, math.inf, 0, counted=True)
        wanted = {column: name, "setting": setting, "condition": condition}
        wanted |= {"metric": part.quantity} if table == "differences" else {}
        if rows and arms is not None and all(row[column] != name for row in rows):
            found = _of_seeds(path.with_name(SEEDS), arms[name], setting, condition, sign)
        else:
            found = _estimate(row(**wanted), rows, sign, part.against)
        if found.run and arms is not None and baselines is not None and baselines.is_file():
            under = [condition, *part.learnt]
            both = _learnt(path.with_name("cells.csv"), baselines, arms[name], setting, under)
            found = replace(found, learnt=both)
        return found

    for name in part.names:
        if table == "recorded":
            yield Evidence(name, _recorded(row(name=name), sign) if stored else NOT_RUN)
            continue
        for setting in part.settings:
            place = name if setting == "-" else f"{name}, {setting}"
            for condition in ("test",) if table == "cost" else part.conditions:
                label = place if condition == "test" else f"{place}, {condition}"
                yield Evidence(label, estimated(name, setting, condition))


def _of_seeds(path: Path, arms: Sequence[str], setting: str, condition: str, sign: float) -> Estimate:
    """The difference of two arms, the treatment first, from the values of their runs, paired by seed.

    Where a table has worlds, the mean of the pairs of a world is one replicate.

    Raises:
        UserError: both arms were run, but not in this setting and condition.
    """
    rows = [row for row in read_table(path) if row["outcome"] == "finished"]
    if not set(arms) <= {row["arm"] for row in rows}:
        return NOT_RUN
    here = [row for row in rows if (row["setting"], row["condition"]) == (setting, condition)]
    of_worlds = bool(here) and "world" in here[0].cells
    treatment, control = ({_pair(row): row.number("value") for row in here if row["arm"] == arm} for arm in arms)
    apart: dict[str, list[float]] = {}
    for pair, value in treatment.items():
        if pair in control:
            apart.setdefault(pair[0] if of_worlds else pair[1], []).append(sign * (value - control[pair]))
    pairs = [statistics.fmean(values) for values in apart.values()]
    if not pairs:
        raise UserError(f"{path} has no pair of {' and '.join(arms)}, setting={setting} condition={condition}", STORED)
    found = Estimate.of_pairs(statistics.fmean(pairs), spread_of(np.array(pairs)), len(pairs))
    return replace(found, replicate="worlds") if of_worlds else found


def _pair(row: Row) -> tuple[str, str]:
    return row.cells.get("world", ""), row["pair"]


def _learnt(cells_file: Path, baselines: Path, arms: Sequence[str], setting: str, conditions: Sequence[str]) -> bool:
    """Whether the intervals of the arms lie on the better side of the constant under each condition that has one."""
    constants = {(row["setting"], row["condition"]): row for row in read_table(baselines)}
    cells = {(row["setting"], row["arm"], row["condition"]): row for row in read_table(cells_file)}
    for condition in conditions:
        for arm in arms:
            constant, cell = constants.get((setting, condition)), cells.get((setting, arm, condition))
            if constant is None or cell is None or cell["low"] == "nan":
                continue
            lower, value = constant["better"] == "lower", constant.number("value")
            if not (cell.number("high") < value if lower else cell.number("low") > value):
                return False
    return True


def _estimate(row: Row, rows: Sequence[Row], sign: float, against: float | str) -> Estimate:
    if row["mean"] in ("", "nan"):  # no pair of runs converged
        return Estimate(math.nan, math.nan, 0, 0)
    mean = sign * (row.number("mean") - (against if isinstance(against, float) else 0.0))
    if "freedom" in row.cells:  # Welch's test; seeds are those of the smallest group in any stratum
        same = [other for other in rows if all(other[key] == row[key] for key in ("contrast", "condition"))]
        strata = [row] if row["setting"] != "together" else [each for each in same if each["setting"] != "together"]
        seeds = min(each.count(group) for each in strata or [row] for group in ("treatment", "control"))
        low, high = (row.number(key) for key in ("low", "high"))
        if row["freedom"] == "inf" or high - low <= ALIKE * abs(low + high):  # the runs of each group are alike
            return Estimate(mean, 0.0, math.inf, seeds)
        freedom = row.number("freedom")
        return Estimate(mean, (high - low) / 2 / float(stats.t.ppf(1 - TAIL, freedom)), freedom, seeds)
    seeds, floor = row.count("seeds"), row.number("floor_mean") if row.cells.get("floor_mean") else 0.0
    spread = row.number("spread", 0) if seeds > 1 else math.nan
    if spread <= ALIKE * abs(row.number("mean")):  # stored before such spreads were 0
        spread = 0.0
    found = Estimate.of_pairs(mean, spread, seeds, floor, _image_half(row))
    return replace(found, replicate="worlds") if row.cells.get("replicate") == "worlds" else found


def _image_half(row: Row) -> float:
    """Half the interval for which images are a sample, from the end that is not cut at the largest difference."""
    if row.cells.get("image_low", "nan") in ("", "nan"):
        return math.nan
    mean = row.number("mean")
    return max(mean - row.number("image_low"), row.number("image_high") - mean)


def _recorded(row: Row, sign: float) -> Estimate:
    mean = round(sign * (row.number("mean") - row.number("against")), ROUNDING)
    if row["seeds"] == COUNTED:
        return Estimate(mean, 0.0, math.inf, 0, counted=True)
    seeds = row.count("seeds")
    if not row["low"]:
        return Estimate(mean, math.nan, seeds - 1, seeds)
    ends = sorted(round(sign * (row.number(end) - row.number("against")), ROUNDING) for end in ("low", "high"))
    replicate = row.cells.get("replicate", "seeds")
    if replicate not in REPLICATES:
        raise UserError(f"{row.place}: replicate={replicate} must be {', '.join(REPLICATES)}", STORED)
    return Estimate(mean, math.nan, seeds - 1, seeds, known=(ends[0], ends[1]), replicate=REPLICATES[replicate])
