"""Paired contrasts between the arms of a sweep."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from sextant.evaluation import SEEDS_FOR_A_CLAIM, PairedDifference, holm, paired_difference
from sextant.evaluation.verdict import LEAST
from sextant.reports.results import CellResult, SweepResults
from sextant.tables import NOTHING, TextTable, interval, number, with_interval

Sides = Mapping[str, str]
Pair = tuple[CellResult, CellResult]


@dataclass(frozen=True)
class ContrastRow:
    """One contrast in one setting under one condition; treatment minus control, in the unit of the measure.

    Attributes:
        paired: paired difference over the pairs in which both runs converged; None without such a pair.
        dropped: number of planned pairs left out because a run diverged, failed or is missing.
        everything: mean difference over all tested pairs, including diverged runs; a run stopped by a nan was not
            tested.
        p_holm: Wilcoxon's p, corrected for all conditions of this contrast in this setting. If it were also corrected
            over all settings, ten seeds and forty tests could not get below 0.078, whatever the effect.
        floor: the same difference between the noise-floor arms, that is, the effect of the seeds alone.
        published: the published single-run difference, nan if there is none.
        least: number of pairs, of seeds or of worlds, that a claim needs.
    """

    contrast: str
    setting: str
    condition: str
    paired: PairedDifference | None
    dropped: int
    everything: float
    p_holm: float
    floor: PairedDifference | None
    published: float
    least: int = SEEDS_FOR_A_CLAIM

    @property
    def single_pair_reach(self) -> float:
        """Half-width of the range in which one more pair of runs of the *same* network falls 95 times in 100.

        A prediction interval around zero: ``t_{n-1} · s · sqrt(1 + 1/n)``, with s the standard deviation
        of the n floor pairs.
        """
        if self.floor is None or self.floor.seeds < 2:
            return float("nan")
        n = self.floor.seeds
        return float(stats.t.ppf(0.975, n - 1) * self.floor.spread * math.sqrt(1 + 1 / n))

    @property
    def exploratory(self) -> bool:
        """Whether fewer pairs converged than a claim needs."""
        return self.paired is None or self.paired.seeds < self.least


def footnotes(rows: Sequence[ContrastRow]) -> str:
    """Explanations of the dashes for differences over one pair, and of the daggers; empty if there are none."""
    told = []
    if any(row.paired is not None and row.paired.seeds == 1 for row in rows):
        told.append("A difference of one pair has neither an interval nor a p.")
    if any(row.exploratory for row in rows):
        told.append(f"† fewer than {rows[0].least} pairs: exploratory.")
    return " ".join(told)


def contrast_table(rows: Sequence[ContrastRow], name: str, results: SweepResults) -> TextTable:
    """One row per setting and condition of one contrast with a pair of runs that converged."""
    n = results.measure.digits
    columns = [
        "setting",
        "condition",
        "published",
        "difference",
        f"95 % over {results.replicate}",
        f"95 % over {results.replicate} and {results.measure.items}",
        "noise floor",
        "spread of one pair",
        "pairs",
        "dropped",
        "wins",
        "p (Wilcoxon, Holm)",
        "with diverged",
    ]
    body = []
    for row in (row for row in rows if row.contrast == name):
        paired, floor = row.paired, row.floor
        if paired is None:
            continue
        body.append(
            [
                row.setting,
                row.condition,
                number(row.published, n, sign=True),
                number(paired.mean, n, sign=True),
                interval(paired.low, paired.high, n, sign=True),
                interval(paired.image_low, paired.image_high, n, sign=True),
                with_interval(floor, n, sign=True),
                NOTHING if floor is None else number(floor.spread, n),
                f"{paired.seeds}{'†' if row.exploratory else ''}",
                str(row.dropped),
                f"{paired.wins}/{paired.seeds}",
                number(row.p_holm, 3),
                number(row.everything, n, sign=True),
            ]
        )
    return TextTable(columns, body)


def contrasts(results: SweepResults) -> list[ContrastRow]:
    """Every contrast of the sweep; a family of Holm's correction is the conditions of one contrast in one setting."""
    if results.plan.is_search:  # trials are compared by the validation metric alone
        return []
    named = named_contrasts(results)
    floor_sides = named.get(noise_floor(results))
    rows: list[ContrastRow] = []
    for name, sides in named.items():
        for setting in settings_of(results, sides):
            found = [_row(results, name, sides, floor_sides, setting, c) for c in results.conditions]
            adjusted = holm([float("nan") if row.paired is None else row.paired.p_value for row in found])
            rows += [replace(row, p_holm=p) for row, p in zip(found, adjusted, strict=True)]
    return rows


def named_contrasts(results: SweepResults) -> Mapping[str, Sides]:
    """``treatment`` and ``control`` by the name of the contrast; by default every arm against the first."""
    arms = results.arms
    against_first = {f"{arm} - {arms[0]}": {"treatment": arm, "control": arms[0]} for arm in arms[1:]}
    return results.plan.definition.get("contrasts") or against_first


def settings_of(results: SweepResults, sides: Sides) -> list[str]:
    """The settings in which both arms are planned."""
    return [setting for setting in results.settings if set(sides.values()) <= set(results.arms_of(setting))]


def noise_floor(results: SweepResults) -> str:
    """The name of the contrast between arms that differ only in their seeds; empty if there is none."""
    return str(results.plan.definition.get("noise_floor") or "")


def converged_pairs(results: SweepResults, setting: str, sides: Sides) -> list[Pair]:
    """Treatment and control of each planned pair in which both runs converged."""
    return [pair for pair in _pairs(results, setting, sides) if _converged(pair)]


def dropped_pairs(results: SweepResults, setting: str, sides: Sides) -> int:
    """The number of planned pairs with a run that diverged, failed or is missing."""
    return len(results.of(setting, sides["treatment"])) - len(converged_pairs(results, setting, sides))


def _row(
    results: SweepResults, name: str, sides: Sides, floor_sides: Sides | None, setting: str, condition: str
) -> ContrastRow:
    pairs = _pairs(results, setting, sides)
    return ContrastRow(
        contrast=name,
        setting=setting,
        condition=condition,
        paired=_difference(pairs, condition),
        dropped=dropped_pairs(results, setting, sides),
        everything=_mean_of_all(pairs, condition),
        p_holm=float("nan"),
        floor=None if floor_sides is None else _difference(_pairs(results, setting, floor_sides), condition),
        published=results.published(setting, sides["treatment"], condition)
        - results.published(setting, sides["control"], condition),
        least=LEAST[results.replicate],
    )


def _pairs(results: SweepResults, setting: str, sides: Sides) -> list[Pair]:
    controls = {result.cell.pair: result for result in results.of(setting, sides["control"])}
    both = ((t, controls.get(t.cell.pair)) for t in results.of(setting, sides["treatment"]))
    return [(t, c) for t, c in both if c is not None and t.values and c.values]


def _converged(pair: Pair) -> bool:
    return all(result.outcome == "finished" for result in pair)


def _difference(pairs: list[Pair], condition: str) -> PairedDifference | None:
    kept = [pair for pair in pairs if _converged(pair)]
    if not kept:
        return None
    sides = [list(arm) for arm in zip(*kept, strict=True)]
    arms = [[side.values[condition] for side in arm] for arm in sides]
    other_images = len({images.shape for arm in arms for images in arm}) > 1  # the arms are of different datasets
    other_images |= bool(sides[0][0].cell.world)  # each world has its own
    if other_images or sides[0][0].measure.statistic == "median":
        arms = [[np.float64(side.value(condition)) for side in arm] for arm in sides]
    treatment, control = (np.stack(arm) for arm in arms)
    measure = sides[0][0].measure
    return paired_difference(treatment, control, better=measure.better, largest=measure.largest)


def _mean_of_all(pairs: list[Pair], condition: str) -> float:
    differences = [t.value(condition) - c.value(condition) for t, c in pairs]
    return float(np.mean(differences)) if differences else float("nan")
