"""The part of a report for localizers tested with several numbers of particles: how many each arm needs."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Int64
from numpy import ndarray

from sextant.chapters.localization.figures.success_curves import SuccessCurve, success_curves
from sextant.chapters.localization.measure import SUCCESS
from sextant.evaluation.particle_counts import RESAMPLES, CountRatio, needed_ratio, particles_needed
from sextant.evaluation.protocols import ENOUGH_SUCCESS
from sextant.evaluation.success import Share, share_of
from sextant.evaluation.verdict import Replicate
from sextant.reports.contrasts import Sides, converged_pairs, dropped_pairs, named_contrasts
from sextant.reports.results import CellResult, SweepResults
from sextant.reports.section import Section
from sextant.tables import TextTable, interval, number, slug

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: name of all conditions together
POOLED = "all conditions"
COUNT = re.compile(r"^(?P<condition>.+), (?P<count>\d+) particles$")


@dataclass(frozen=True, eq=False)
class Curve:
    """Success of one arm with each number of particles.

    Attributes:
        setting, arm, condition: names of the setting, arm and condition.
        counts: numbers of particles, ascending.
        successes: whether each run along a drive succeeded, by count and seed.
    """

    setting: str
    arm: str
    condition: str
    counts: Int64[ndarray, "k"]
    successes: Bool[ndarray, "k seeds runs"]

    @property
    def pooled(self) -> Bool[ndarray, "k all"]:
        """The successes pooled over seeds."""
        return self.successes.reshape(len(self.counts), -1)

    @property
    def shares(self) -> list[Share]:
        """The share of successful runs at each count, with Wilson's interval."""
        return [share_of(runs) for runs in self.pooled]

    @property
    def needed(self) -> float:
        """The smallest count that is sufficient; inf if none is."""
        return particles_needed(self.counts, self.pooled)

    @property
    def told(self) -> str:
        """The smallest sufficient count as text, or a lower bound if none is."""
        return f"> {self.counts[-1]:,}" if np.isinf(self.needed) else f"{self.needed:,.0f}"


@dataclass(frozen=True)
class RatioRow:
    """The ratio of the particles needed by the treatment and the control of a contrast.

    Attributes:
        treatment, control: their curves over converged pairs only; None without such a pair.
        ratio: ratio of the numbers of particles needed; None without such a pair.
        pairs, dropped: numbers of planned pairs in which both runs converged, and of the others.
    """

    contrast: str
    setting: str
    condition: str
    treatment: Curve | None
    control: Curve | None
    ratio: CountRatio | None
    pairs: int
    dropped: int


def particles_section(results: SweepResults) -> Section:
    """Tables, and a plot per setting and condition; empty unless several numbers of particles were tested."""
    curves = arm_curves(results)
    if results.measure != SUCCESS or not curves:
        return Section()
    ratios = particle_ratios(results)
    parts = ["## Success by number of particles\n", _legend(), curve_table(curves).markdown()]
    pictured = [curve for curve in curves if curve.condition == POOLED]
    names = dict.fromkeys(_figure_name(curve.setting, POOLED) for curve in pictured)
    parts += [f"![success by number of particles]({name}.png)\n" for name in names]
    if ratios:
        parts += [
            "### Particles needed, relative\n",
            _ratio_legend(),
            ratio_table(ratios, results.replicate).markdown(),
        ]
    files = {"particles.csv": curve_rows(curves).csv(), "particles_needed.csv": ratio_rows(ratios).csv()}
    return Section("\n".join(parts), files, list(_figures(curves)))


def arm_curves(results: SweepResults) -> list[Curve]:
    """The curves of every setting and arm over converged runs, for all conditions together and then by condition."""
    curves = []
    for setting in results.settings:
        for arm in results.arms:
            cells = [cell for cell in results.of(setting, arm) if cell.outcome == "finished" and cell.values]
            curves += curves_of(setting, arm, cells)
    return curves


def curves_of(setting: str, arm: str, cells: Sequence[CellResult]) -> list[Curve]:
    """The curves of some runs of an arm; empty unless they share conditions tested with several counts."""
    trials = _trials(cells)
    each = {
        condition: np.stack([_successes(cells, names[count]) for count in sorted(names)])
        for condition, names in trials.items()
        if len(names) > 1
    }
    counts = {condition: sorted(trials[condition]) for condition in each}
    found = [
        Curve(setting, arm, condition, np.array(counts[condition], np.int64), successes)
        for condition, successes in each.items()
    ]
    if found and all(counts[curve.condition] == counts[found[0].condition] for curve in found):
        together = np.concatenate([curve.successes for curve in found], axis=2)
        found.insert(0, Curve(setting, arm, POOLED, found[0].counts, together))
    return found


def _trials(cells: Sequence[CellResult]) -> dict[str, dict[int, str]]:
    """The names of the trials that all runs share, by condition and number of particles."""
    found: dict[str, dict[int, str]] = {}
    if not cells:
        return found
    for name in cells[0].values:
        matched = COUNT.match(name)
        if matched and all(name in cell.values for cell in cells):
            found.setdefault(matched["condition"], {})[int(matched["count"])] = name
    return found


def _successes(cells: Sequence[CellResult], name: str) -> Bool[ndarray, "seeds runs"]:
    """Which runs succeeded; every seed is cut to the number of runs of the seed with the fewest."""
    fewest = min(len(cell.values[name]) for cell in cells)
    return np.stack([cell.values[name][:fewest] > 0 for cell in cells])


def particle_ratios(results: SweepResults) -> list[RatioRow]:
    """The ratios of every contrast in every setting under every condition, over pairs of converged runs."""
    rows: list[RatioRow] = []
    for name, sides in named_contrasts(results).items():
        for setting in results.settings:
            rows += _ratios(results, name, sides, setting)
    return rows


def _ratios(results: SweepResults, name: str, sides: Sides, setting: str) -> Iterator[RatioRow]:
    pairs, dropped = converged_pairs(results, setting, sides), dropped_pairs(results, setting, sides)
    if not pairs:
        yield RatioRow(name, setting, POOLED, None, None, None, 0, dropped)
        return
    treated, controls = (
        {curve.condition: curve for curve in curves_of(setting, sides[side], cells)}
        for side, cells in zip(("treatment", "control"), zip(*pairs, strict=True), strict=True)
    )
    for condition, treatment in treated.items():
        control = controls.get(condition)
        if control is not None:
            ratio = needed_ratio((treatment.counts, treatment.successes), (control.counts, control.successes))
            yield RatioRow(name, setting, condition, treatment, control, ratio, len(pairs), dropped)


# -- tables ------------------------------------------------------------------------------------------------------------


def curve_table(curves: Sequence[Curve]) -> TextTable:
    """One row per curve: per cent of successes at each count with Wilson's interval, and the sufficient count."""
    counts = sorted({int(count) for curve in curves for count in curve.counts})
    rows = []
    for curve in curves:
        shares = dict(zip(curve.counts.tolist(), curve.shares, strict=True))
        cells = [_percent(shares[count]) if count in shares else "–" for count in counts]
        runs = str(curve.pooled.shape[1])
        rows.append([curve.setting, curve.arm, curve.condition, runs, *cells, curve.told])
    columns = ["setting", "arm", "condition", "runs", *(f"{count:,}" for count in counts), _needed_name()]
    return TextTable(columns, rows)


def curve_rows(curves: Sequence[Curve]) -> TextTable:
    """One row per curve and count, for a file."""
    rows = [
        [curve.setting, curve.arm, curve.condition, str(count), str(share.runs), str(share.count)]
        + [str(value) for value in (share.rate, share.low, share.high, curve.needed)]
        for curve in curves
        for count, share in zip(curve.counts.tolist(), curve.shares, strict=True)
    ]
    columns = ["setting", "arm", "condition", "particles", "runs", "successes", "rate", "low", "high", "needed"]
    return TextTable(columns, rows)


def ratio_table(rows: Sequence[RatioRow], replicate: Replicate) -> TextTable:
    """One row per contrast, setting and condition."""
    body = []
    for row in rows:
        told = ["–"] * 4
        if row.treatment is not None and row.control is not None and row.ratio is not None:
            told = [row.treatment.told, row.control.told, *_ratio_told(row.ratio)]
        pairs = [str(row.pairs), str(row.dropped)]
        body.append([row.contrast, row.setting, row.condition, *told, *pairs])
    needed = _needed_name()
    columns = ["contrast", "setting", "condition", f"{needed} of the treatment", f"{needed} of the control"]
    return TextTable([*columns, "ratio", f"95 % over {replicate}", "pairs", "dropped"], body)


def ratio_rows(rows: Sequence[RatioRow]) -> TextTable:
    """The same values as plain numbers, for a file."""
    body = []
    for row in rows:
        values = ["–"] * 7
        if row.treatment is not None and row.control is not None and row.ratio is not None:
            found = row.ratio
            ends = (found.least, found.most, found.low, found.high, found.censored)
            values = [str(value) for value in (row.treatment.needed, row.control.needed, *ends)]
        body.append([row.contrast, row.setting, row.condition, *values, str(row.pairs), str(row.dropped)])
    columns = ["contrast", "setting", "condition", "treatment", "control", "least", "most", "low", "high", "censored"]
    return TextTable([*columns, "pairs", "dropped"], body)


def _ratio_told(ratio: CountRatio) -> list[str]:
    """The ratio, or the known bound on it, and its interval."""
    if ratio.least == ratio.most:
        told = number(ratio.least)
    elif np.isfinite(ratio.most):
        told = f"at most {number(ratio.most)}"
    elif ratio.least > 0:
        told = f"at least {number(ratio.least)}"
    else:
        told = "unknown: neither succeeds often enough"
    censored = f", {100 * ratio.censored:.0f} % censored" if ratio.censored else ""
    return [told, interval(ratio.low, ratio.high) + censored]


def _percent(share: Share) -> str:
    return f"{100 * share.rate:.0f} {interval(100 * share.low, 100 * share.high, 0)}"


def _needed_name() -> str:
    return f"N{100 * ENOUGH_SUCCESS:.0f}"


def _legend() -> str:
    return (
        "Per cent of the runs along the test drives that succeeded, over all converged seeds, with Wilson's interval "
        "at 95 %, which assumes independent runs; those of one seed share a trained model, so the intervals are too "
        f"narrow. {_needed_name()} is the smallest number tried with which {100 * ENOUGH_SUCCESS:.0f} % "
        "succeed.\n"
    )


def _ratio_legend() -> str:
    return (
        f"{_needed_name()} of the treatment over that of the control; below 1 the treatment needs fewer. The interval "
        f"is a percentile bootstrap of {RESAMPLES:,} resamples over pairs of seeds, each drawn with all its runs. "
        "Where no number tried is enough, only a bound on the ratio and on its interval is known; *censored* is the "
        "share of such resamples. An interval of one point means that every resample chose the same of the numbers "
        "tried, not that the ratio is exact.\n"
    )


# -- pictures ----------------------------------------------------------------------------------------------------------


def _figures(curves: Sequence[Curve]) -> "Iterator[tuple[str, Figure]]":
    panels: dict[tuple[str, str], dict[str, SuccessCurve]] = {}
    for curve in curves:
        panels.setdefault((curve.setting, curve.condition), {})[curve.arm] = _drawn(curve)
    for (setting, condition), drawn in panels.items():
        title = condition if setting == "-" else f"{setting}: {condition}"
        yield _figure_name(setting, condition), success_curves(drawn, title)


def _drawn(curve: Curve) -> SuccessCurve:
    rates, low, high = (np.array([getattr(share, end) for share in curve.shares]) for end in ("rate", "low", "high"))
    return SuccessCurve(curve.counts, rates, low, high)


def _figure_name(setting: str, condition: str) -> str:
    return "_".join(["success_curves", *(slug(part) for part in (setting, condition) if part not in ("-", POOLED))])
