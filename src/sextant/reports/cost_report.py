"""Costs of the arms of a sweep: parameters, multiplications and training time."""

from collections.abc import Sequence

import numpy as np

from sextant.reports.contrasts import named_contrasts
from sextant.reports.results import CellResult, SweepResults
from sextant.reports.section import Section
from sextant.tables import NOTHING, TextTable, number


def cost_section(results: SweepResults) -> Section:
    """A table with one row per arm and setting; ratios are relative to the control of the first contrast."""
    table = cost_table(results)
    reference = reference_arm(results)
    text = (
        "## Cost\n\n"
        f"Ratios are to *{reference}*. Multiplications are those of one image through the whole network, with the pull "
        "as a second convolution; *inhibited layers* says how they were computed. Training times are of runs that "
        "trained here, under whatever load the machine had: compare them with care.\n\n"
    )
    return Section(text + table.markdown(), {"cost.csv": table.csv()})


def reference_arm(results: SweepResults) -> str:
    """The arm to which costs are relative."""
    sides = next(iter(named_contrasts(results).values()), None)
    return results.arms[0] if sides is None else sides["control"]


def cost_table(results: SweepResults) -> TextTable:
    """Parameters, multiplications and training time of each arm; a dash for what the runs do not report."""
    said = any(cell.cost for cell in results.cells)
    columns = ["setting", "arm", "parameters"]
    columns += ["multiplications (M)", "ratio", "of them the pull (M)", "inhibited layers"] if said else []
    columns += ["runs timed", "training, median (s)", "fastest to slowest (s)", "ratio"]
    rows = []
    for setting in results.settings:
        beside = results.of(setting, reference_arm(results))
        for arm in results.arms_of(setting):
            cells = results.of(setting, arm)
            parameters = next((cell.parameters for cell in cells if cell.parameters), None)
            row = [setting, arm, NOTHING if parameters is None else f"{parameters:,}"]
            rows.append(row + (_multiplications(cells, beside) if said else []) + _times(cells, beside))
    return TextTable(columns, rows)


def multiplications(results: SweepResults, setting: str, arm: str) -> float:
    """Multiplications of an arm relative to those of the reference arm; nan if the runs do not report them."""
    count, beside = (_said(results.of(setting, each), "multiplications") for each in (arm, reference_arm(results)))
    return _ratio(count, beside)


def _multiplications(cells: Sequence[CellResult], beside: Sequence[CellResult]) -> list[str]:
    count, pull = _said(cells, "multiplications"), _said(cells, "pull_multiplications")
    ratio = _ratio(count, _said(beside, "multiplications"))
    return [number(count / 1e6), number(ratio, 3), number(pull / 1e6), _inhibition(cells)]


def _times(cells: Sequence[CellResult], beside: Sequence[CellResult]) -> list[str]:
    seconds = _seconds(cells)
    if not seconds:
        return ["0", *[NOTHING] * 3]
    ratio = _ratio(_median(seconds), _median(_seconds(beside)))
    return [
        *(str(len(seconds)), number(_median(seconds), 1)),
        *(f"{min(seconds):.1f} to {max(seconds):.1f}", number(ratio)),
    ]


def _seconds(cells: Sequence[CellResult]) -> list[float]:
    """Training times of the runs that trained, without tested checkpoints (0) and runs stopped by a nan."""
    return [cell.seconds for cell in cells if cell.seconds > 0]


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else float("nan")


def _said(cells: Sequence[CellResult], key: str) -> float:
    return next((float(cell.cost[key]) for cell in cells if key in cell.cost), float("nan"))


def _ratio(value: float, other: float) -> float:
    return value / other if other else float("nan")


def _inhibition(cells: Sequence[CellResult]) -> str:
    cost = next((cell.cost for cell in cells if cell.cost), {})
    found = cost.get("inhibition") or {}
    return ", ".join(f"{path}: {how}" for path, how in found.items()) or NOTHING
