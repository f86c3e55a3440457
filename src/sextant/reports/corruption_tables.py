"""Tables of errors under a published set of corruptions, in per cent; differences are in points."""

from collections.abc import Mapping, Sequence

from sextant.chapters.classification.figures import by_family
from sextant.evaluation import CORRUPTION_FAMILIES, CorruptionBaseline, PairedDifference, corruption_score
from sextant.kit.measure import SharedSet
from sextant.reports.corruption_contrasts import ArmErrors, CorruptionContrast, OverSeeds, of_corruption
from sextant.reports.results import SweepResults
from sextant.tables import NOTHING, TextTable, interval, number, p_text


def score_table(
    arms: Sequence[ArmErrors], baseline: CorruptionBaseline, sets: Mapping[str, Sequence[str]]
) -> TextTable:
    """mCE and mean relative CE of each arm beside ``baseline``: mean ± standard deviation and interval over seeds.

    The clean error is shown beside them, since a worse clean error lowers the relative CE.
    """
    columns = ["setting", "arm", "seeds", "clean error, %"]
    columns += [f"{kind} {name}" for name in sets for kind in ("mCE", "relative mCE")]
    rows = []
    for arm in arms:
        cells = [_over_seeds(OverSeeds.of_shares([run.clean for run in arm.runs]))]
        for corruptions in sets.values():
            scores = [corruption_score(run, baseline, corruptions) for run in arm.runs]
            cells.append(_over_seeds(OverSeeds.of([score.mean_ce for score in scores])))
            cells.append(_over_seeds(OverSeeds.of([score.mean_relative_ce for score in scores])))
        rows.append([arm.setting, arm.arm, str(len(arm.runs)), *cells])
    return TextTable(columns, rows)


def overview_table(contrasts: Sequence[CorruptionContrast]) -> TextTable:
    """One row per contrast and setting: the mean difference, and on how many corruptions it has either sign."""
    columns = ["setting", "contrast", "pairs", "dropped", "E control", "E treatment", "difference", "95 % over seeds"]
    columns += ["pairs won", "better on", "worse on", "better for certain", "worse for certain"]
    columns += ["better under Holm", "worse under Holm"]
    rows = []
    for contrast in contrasts:
        name = f"{contrast.title}{' (noise floor)' if contrast.is_floor else ''}"
        row = [contrast.setting, name, f"{contrast.pairs}{'†' if contrast.exploratory else ''}", str(contrast.dropped)]
        found = contrast.differences
        if found is None:
            rows.append([*row, *[NOTHING] * (len(columns) - len(row))])
            continue
        counts = [found.wins, found.losses, found.certain_wins, found.certain_losses]
        counts += [found.holm_wins, found.holm_losses]
        rows.append([*row, *_compared(contrast, None), *(f"{count}/{len(found.by_corruption)}" for count in counts)])
    return TextTable(columns, rows)


def difference_table(contrast: CorruptionContrast) -> TextTable:
    """One row per corruption of one contrast in one setting, by family, with the mean last; empty without pairs."""
    columns = ["family", "corruption", "E control", "E treatment", "difference", "95 % over seeds", "pairs won"]
    columns += ["p (t, Holm)"]
    columns += ["noise floor"] if contrast.floor is not None else []
    if contrast.differences is None:
        return TextTable(columns, [])
    names: list[tuple[str, str | None]] = [
        (family, name) for family, members in by_family(contrast.treatment, CORRUPTION_FAMILIES) for name in members
    ]
    rows = []
    for family, name in [*names, ("", None)]:
        label = f"**mean of {len(names)}**" if name is None else name.replace("_", " ")
        floor = [] if contrast.floor is None else [_with_interval(of_corruption(contrast.floor, name))]
        p_holm = NOTHING if name is None else p_text(contrast.differences.p_holm[name])
        rows.append([family, label, *_compared(contrast, name), p_holm, *floor])
    return TextTable(columns, rows)


def _compared(contrast: CorruptionContrast, name: str | None) -> list[str]:
    """Errors of both arms, their difference with its interval, and the pairs won, under one corruption or all."""
    found = of_corruption(contrast.differences, name)
    errors = [number(100 * contrast.error(side, name)) for side in ("control", "treatment")]
    ends = (NOTHING, NOTHING) if found is None else _difference(found)
    return [*errors, *ends, f"{contrast.won_pairs(name)}/{contrast.pairs}"]


def error_rows(arms: Sequence[ArmErrors], shared: SharedSet) -> TextTable:
    """Mean error of each arm by corruption and severity, for a file."""
    columns = ["setting", "arm", "corruption", "severity", "seeds", "error", "spread", "low", "high"]
    rows = []
    for arm in arms:
        conditions = [("clean", "", [run.clean for run in arm.runs])]
        for name, levels in shared.severities.items():
            for i, severity in enumerate(levels):
                conditions.append((name, str(severity), [run.severities[name][i] for run in arm.runs]))
        for name, at, values in conditions:
            over = OverSeeds.of_shares(values)
            numbers = [str(100 * value) for value in (over.mean, over.spread, over.low, over.high)]
            rows.append([arm.setting, arm.arm, name, at, str(len(values)), *numbers])
    return TextTable(columns, rows)


def difference_rows(contrasts: Sequence[CorruptionContrast]) -> TextTable:
    """Every contrast in every setting by corruption, for a file; the row ``mean`` is the mean over corruptions."""
    columns = ["contrast", "setting", "corruption", "pairs", "dropped", "control", "treatment"]
    columns += ["difference", "low", "high", "pairs_won", "floor", "floor_low", "floor_high", "t_p_value", "p_holm"]
    rows = []
    for contrast in contrasts:
        for name in [*contrast.treatment, None] if contrast.differences is not None else []:
            found, floor = of_corruption(contrast.differences, name), of_corruption(contrast.floor, name)
            numbers = [contrast.error("control", name), contrast.error("treatment", name), *_ends(found)]
            rows.append(
                [
                    *(contrast.contrast, contrast.setting, name or "mean", str(contrast.pairs), str(contrast.dropped)),
                    *(str(100 * value) for value in numbers),
                    str(contrast.won_pairs(name)),
                    *("" if floor is None else str(100 * value) for value in _ends(floor)),
                    *_p_values(contrast, name),
                ]
            )
    return TextTable(columns, rows)


def _p_values(contrast: CorruptionContrast, name: str | None) -> tuple[str, str]:
    """The p of the paired t test, raw and corrected for the number of corruptions; their mean is not corrected."""
    found = of_corruption(contrast.differences, name)
    if found is None or contrast.differences is None:
        return ("", "")
    return (str(found.t_p_value), "" if name is None else str(contrast.differences.p_holm[name]))


def seed_error_rows(results: SweepResults) -> TextTable:
    """The error of every run by corruption, averaged over severities, for a file; includes diverged runs."""
    rows = [
        [
            *(cell.cell.setting, cell.cell.arm, str(cell.cell.pair), str(cell.cell.seed), cell.outcome),
            *(name, str(100 * error)),
        ]
        for cell in results.cells
        if cell.errors is not None
        for name, error in {"clean": cell.errors.clean, **cell.errors.by_corruption()}.items()
    ]
    return TextTable(["setting", "arm", "pair", "seed", "outcome", "corruption", "error"], rows)


def _ends(found: PairedDifference | None) -> tuple[float, float, float]:
    return (float("nan"),) * 3 if found is None else (found.mean, found.low, found.high)


def _difference(found: PairedDifference) -> tuple[str, str]:
    return number(100 * found.mean, sign=True), interval(100 * found.low, 100 * found.high, sign=True)


def _with_interval(found: PairedDifference | None) -> str:
    if found is None:
        return NOTHING
    mean, ends = _difference(found)
    return f"{mean} {ends}" if ends != NOTHING else mean


def _over_seeds(value: OverSeeds) -> str:
    mean, spread = number(100 * value.mean), number(100 * value.spread)
    return f"{mean} ± {spread} {interval(100 * value.low, 100 * value.high)}"
