"""The part of a report for runs tested under a published set of corruptions: errors by corruption."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from sextant.chapters.classification.figures import (
    LEAST,
    DifferenceBar,
    corruption_difference,
    corruption_heatmap,
    corruption_radar,
)
from sextant.chapters.classification.report import baseline_of
from sextant.evaluation import CORRUPTION_FAMILIES, SEEDS_FOR_A_CLAIM
from sextant.kit.measure import SharedSet, summary_conditions
from sextant.reports.corruption_contrasts import (
    ArmErrors,
    CorruptionContrast,
    arm_errors,
    corruption_contrasts,
)
from sextant.reports.corruption_tables import (
    difference_rows,
    difference_table,
    error_rows,
    overview_table,
    score_table,
    seed_error_rows,
)
from sextant.reports.results import SweepResults
from sextant.reports.section import Section
from sextant.tables import slug

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def corruption_section(results: SweepResults) -> Section:
    """Tables and pictures by corruption; empty if the runs were not tested under a published set.

    Each setting has a radar chart of all arms, a heat map for each arm, and a difference chart for each contrast.
    """
    if results.shared is None:
        return Section()
    arms, contrasts = arm_errors(results), corruption_contrasts(results)
    files = {
        "corruptions.csv": error_rows(arms, results.shared).csv(),
        "corruption_seeds.csv": seed_error_rows(results).csv(),
        "corruption_contrasts.csv": difference_rows(contrasts).csv(),
        "corruption_contrasts.tex": overview_table(contrasts).latex(),
    }
    parts = ["## Under the corruptions\n", _protocol(results.shared), *_scores(arms, results.shared)]
    if contrasts:
        parts += ["### Differences\n", _legend(contrasts), overview_table(contrasts).markdown()]
    for setting in results.settings:
        parts += _setting(setting, arms, contrasts, results)
    return Section("\n".join(parts), files, list(_figures(arms, contrasts, results)))


def _protocol(shared: SharedSet) -> str:
    levels = list(dict.fromkeys(shared.severities.values()))
    if len(levels) == 1:
        severities = f"at severit{'y' if len(levels[0]) == 1 else 'ies'} {', '.join(map(str, levels[0]))}"
    elif max(map(len, levels)) == 1:
        severities = "each at one severity"
    else:
        severities = "not all at the same severities, which are in `corruptions.csv`"
    text = f"{shared.describe()}: {len(shared.severities)} corruptions, {severities}. "
    text += "E is the mean error over the severities of a corruption, then over corruptions. "
    if len(shared.tested) > 1:
        text += "**The runs were tested under different images: their errors cannot be compared.** "
    if shared.left_out:
        text += f"{shared.left_out} conditions are left out, as only some of the runs were tested under them. "
    return text.strip() + "\n"


def _scores(arms: Sequence[ArmErrors], shared: SharedSet) -> list[str]:
    baseline = baseline_of(shared.key, shared.severities)
    if baseline is None:
        return []
    sets = {f"of {len(names)}": names for names in summary_conditions(shared).values()}
    return [
        f"### Beside {baseline.name}\n",
        f"Errors relative to those of the baseline, times 100 ({baseline.source}); below 100 is better than it. Mean ± "
        "standard deviation over converged seeds, and the 95 % t interval of the mean. Relative mCE is a "
        "network's loss relative to its own clean error: **one that errs more on clean images has less to lose, and a "
        "lower relative mCE for it**. Read it beside mCE and the clean error.\n",
        score_table(arms, baseline, sets).markdown(),
    ]


def _legend(contrasts: Sequence[CorruptionContrast]) -> str:
    text = (
        "Errors in per cent, differences in points: below zero the treatment errs less. Intervals are t intervals at "
        "95 % over pairs of converged runs, p is of the paired t test that belongs to them, two-sided. *For certain* "
        "are corruptions whose interval excludes zero, not corrected for their number: of 20 intervals without any "
        "effect one does so by chance. *Under Holm* are those of p below 0.05 after Holm's correction for the number "
        "of corruptions. Corruptions are correlated, so the number of equal signs is no test: compare it with the "
        "noise floor, which shows the effect of seeds alone.\n"
    )
    if any(contrast.exploratory for contrast in contrasts):
        text = text.rstrip() + f" † fewer than {SEEDS_FOR_A_CLAIM} pairs: exploratory.\n"
    return text


def _setting(
    setting: str, arms: Sequence[ArmErrors], contrasts: Sequence[CorruptionContrast], results: SweepResults
) -> Iterator[str]:
    yield f"### {setting}, corruption by corruption\n" if setting != "-" else "### Corruption by corruption\n"
    of_setting = [arm for arm in arms if arm.setting == setting and arm.runs]
    if of_setting and _enough(results.shared):
        yield f"![mean error by corruption, {setting}]({_name('radar', setting)}.png)\n"
    for contrast in contrasts:
        if contrast.setting != setting:
            continue
        if contrast.differences is None:
            yield f"{contrast.title}: no pair of converged runs.\n"
            continue
        yield f"**{contrast.contrast}: {contrast.title}**, {contrast.pairs} pairs, {contrast.dropped} dropped.\n"
        yield f"![differences by corruption]({_name('difference', setting, contrast.contrast)}.png)\n"
        if not contrast.is_floor:
            yield difference_table(contrast).markdown()
    yield (
        "Heat maps: " + ", ".join(f"[{arm.arm}]({_name('heatmap', setting, arm.arm)}.png)" for arm in of_setting) + "\n"
    )


def _figures(
    arms: Sequence[ArmErrors], contrasts: Sequence[CorruptionContrast], results: SweepResults
) -> "Iterator[tuple[str, Figure]]":
    for setting in results.settings:
        means = {arm.arm: arm.mean() for arm in arms if arm.setting == setting and arm.runs}
        if means and _enough(results.shared):
            by_corruption = {arm: errors.by_corruption() for arm, errors in means.items()}
            title = f"{_prefix(setting)}mean error over severities, of converged runs; inside is better"
            yield _name("radar", setting), corruption_radar(by_corruption, families=CORRUPTION_FAMILIES, title=title)
    for arm in arms:
        if arm.runs:
            yield _name("heatmap", arm.setting, arm.arm), _heatmap(arm, results.shared)
    for contrast in contrasts:
        if contrast.differences is not None:
            yield _name("difference", contrast.setting, contrast.contrast), _difference(contrast)


def _heatmap(arm: ArmErrors, shared: SharedSet | None) -> "Figure":
    errors = arm.mean()
    runs = "one run" if len(arm.runs) == 1 else f"mean of {len(arm.runs)} runs"
    levels = list(dict.fromkeys(shared.severities.values())) if shared is not None else []
    if len(levels) == 1:
        names = [str(severity) for severity in levels[0]]
    elif max(map(len, errors.severities.values())) == 1:
        names = ["one each"]
    else:
        names = None
    return corruption_heatmap(
        errors.severities,
        clean=errors.clean,
        families=CORRUPTION_FAMILIES,
        levels=names,
        title=f"{_prefix(arm.setting)}{arm.arm}, {runs}",
    )


def _difference(contrast: CorruptionContrast) -> "Figure":
    found, floor = contrast.differences, contrast.floor
    assert found is not None
    bars = [
        DifferenceBar(name, d.mean, d.low, d.high, float("nan") if floor is None else floor.by_corruption[name].mean)
        for name, d in found.by_corruption.items()
    ]
    mean = DifferenceBar(
        "mean", found.mean.mean, found.mean.low, found.mean.high, float("nan") if floor is None else floor.mean.mean
    )
    title = f"{_prefix(contrast.setting)}{contrast.title}, {contrast.pairs} pairs"
    return corruption_difference(bars, mean=mean, families=CORRUPTION_FAMILIES, title=title)


def _enough(shared: SharedSet | None) -> bool:
    return shared is not None and len(shared.severities) >= LEAST


def _prefix(setting: str) -> str:
    return "" if setting == "-" else f"{setting}: "


def _name(kind: str, *of: str) -> str:
    return "_".join(["corruption", kind, *(slug(part) for part in of if part != "-")])
