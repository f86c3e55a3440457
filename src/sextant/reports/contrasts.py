"""Paired contrasts between the arms of a sweep."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from sextant.evaluation import SEEDS_FOR_A_CLAIM, PairedDifference, holm, paired_difference
from sextant.evaluation.paired import Method
from sextant.evaluation.verdict import LEAST
from sextant.reports.results import CellResult, SweepResults

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


def of_one_pair(rows: Sequence[ContrastRow]) -> str:
    """An explanation of the dashes for differences over one pair; empty if there are none."""
    single = any(row.paired is not None and row.paired.seeds == 1 for row in rows)
    return "A difference of one pair has neither an interval nor a p." if single else ""


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
    method = results.plan.definition.get("interval", "t")
    pairs = _pairs(results, setting, sides)
    return ContrastRow(
        contrast=name,
        setting=setting,
        condition=condition,
        paired=_difference(pairs, condition, method),
        dropped=dropped_pairs(results, setting, sides),
        everything=_mean_of_all(pairs, condition),
        p_holm=float("nan"),
        floor=None if floor_sides is None else _difference(_pairs(results, setting, floor_sides), condition, method),
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


def _difference(pairs: list[Pair], condition: str, method: str) -> PairedDifference | None:
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
    chosen: Method = "bootstrap" if method == "bootstrap" else "t"
    measure = sides[0][0].measure
    return paired_difference(treatment, control, method=chosen, better=measure.better, largest=measure.largest)


def _mean_of_all(pairs: list[Pair], condition: str) -> float:
    differences = [t.value(condition) - c.value(condition) for t, c in pairs]
    return float(np.mean(differences)) if differences else float("nan")
