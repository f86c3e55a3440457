"""The report of a sweep: tables, contrasts and figures, and how far they support conclusions."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

from matplotlib.figure import Figure

from sextant.chapters.classification.figures import severity_curves
from sextant.evaluation.paired import BLOCKS
from sextant.figures.effects import ForestRow, contrast_forest
from sextant.reports.cell_tables import cells_legend, cells_table, diverged_table, runs_table, seed_rows
from sextant.reports.confidence_report import confidence_section
from sextant.reports.contrasts import ContrastRow, contrast_table, contrasts, footnotes
from sextant.reports.corruption_report import corruption_section
from sextant.reports.cost_report import cost_section
from sextant.reports.divergence import divergence
from sextant.reports.effects_report import effects_section
from sextant.reports.factor_report import factor_section
from sextant.reports.metrics_report import metrics_section
from sextant.reports.particles_report import particles_section
from sextant.reports.pooled_report import pooled_section
from sextant.reports.published_verdict import beside_published, published_verdict
from sextant.reports.results import SweepResults
from sextant.reports.search_report import write_search_report
from sextant.reports.section import Section, Summary, head, runs_planned, summarise, write_files
from sextant.reports.tasks_report import of_several_tasks, write_tasks_report
from sextant.tables import TextTable, is_number, slug


def write_report(results: SweepResults) -> list[Path]:
    """Write ``report/`` into the sweep's directory.

    Returns:
        The files: ``report.md``, ``cells.csv``, ``seeds.csv`` (every run), ``contrasts.csv``, ``dates.csv``,
        ``cells.tex``, ``contrasts.tex``, ``cost.csv``, ``pooled.csv`` if there is a noise floor, those of a published
        set of corruptions if the runs were tested under one, ``confidence.csv`` if they are classifiers, those of
        particle counts if several were tested, ``metrics.csv`` and ``differences.csv`` (contrasts in
        these) if the runs have metrics beside their measure, and figures. For a search, see
        :func:`~sextant.reports.search_report.write_search_report`; for a sweep over tasks,
        :func:`~sextant.reports.tasks_report.write_tasks_report`.
    """
    if results.plan.is_search:
        return write_search_report(results)
    if of_several_tasks(results):
        return write_tasks_report(results)
    folder = results.directory / "report"
    folder.mkdir(parents=True, exist_ok=True)
    summaries, rows = summarise(results), contrasts(results)
    replicate: dict[str, object] = {"replicate": results.replicate} if results.replicate == "worlds" else {}
    cells, compared = cells_table(summaries, results), {n: contrast_table(rows, n, results) for n in _names(rows)}
    sections = [cost_section(results)]
    if results.learnt:
        sections = [
            effects_section(results, rows, summaries),
            factor_section(results, summaries),
            pooled_section(results),
            *(corruption_section(results), confidence_section(results), particles_section(results)),
            *(metrics_section(results), *sections),
        ]
    texts = {
        "report.md": _markdown(results, summaries, cells, compared, rows, sections),
        "cells.csv": _csv([asdict(summary) for summary in summaries]),
        "seeds.csv": seed_rows(results).csv(),
        "contrasts.csv": _csv([_flat_row(row) | replicate for row in rows]),
        "dates.csv": _dates(results),
        "cells.tex": cells.latex(),
        "contrasts.tex": "\n".join(table.latex() for table in compared.values()),
    }
    for section in sections:
        texts |= section.files
    made = [*figures(results, summaries, rows), *(pair for section in sections for pair in section.figures)]
    return write_files(folder, texts, made)


def figures(results: SweepResults, summaries: list[Summary], rows: list[ContrastRow]) -> "list[tuple[str, Figure]]":
    """Accuracy against severity for each setting, and a forest plot of each contrast."""
    made = []
    levels = _levels(results.conditions)
    if levels:
        for setting in results.settings:
            of_setting = [s for s in summaries if s.setting == setting and s.seeds]
            if not of_setting:
                continue
            arms = dict.fromkeys(s.arm for s in of_setting)
            accuracy: dict[str, dict[str, float]] = {arm: {} for arm in arms}
            bands: dict[str, dict[str, tuple[float, float]]] = {arm: {} for arm in arms}
            for s in of_setting:
                accuracy[s.arm][s.condition] = s.mean / 100
                bands[s.arm][s.condition] = (s.low / 100, s.high / 100)
            made.append((f"severity_{slug(setting)}", severity_curves(levels, accuracy, bands)))
    return made + contrast_figures(results, rows)


def contrast_figures(results: SweepResults, rows: list[ContrastRow]) -> "list[tuple[str, Figure]]":
    """A forest plot of each contrast with a pair of runs that converged."""
    made = []
    there = [row for row in rows if row.paired is not None]
    for contrast in _names(there):
        of_contrast = [row for row in there if row.contrast == contrast]
        panels = [
            (setting, [_forest_row(row) for row in of_contrast if row.setting == setting])
            for setting in dict.fromkeys(row.setting for row in of_contrast)
        ]
        made.append(
            (f"contrast_{slug(contrast)}", contrast_forest(panels, results.measure.difference, results.replicate))
        )
    return made


def _markdown(
    results: SweepResults,
    summaries: list[Summary],
    cells: TextTable,
    compared: Mapping[str, TextTable],
    rows: list[ContrastRow],
    sections: Sequence[Section],
) -> str:
    told = divergence(results)
    parts = [*head(results), runs_planned(results, "cell"), f"{told}\n" if told else ""]
    if not results.learnt:
        reached = diverged_table(summaries, results).told().markdown() if summaries else ""
        title = f"## {results.measure.title}, of the runs that diverged\n" if summaries else ""
        return "\n".join(part for part in [*parts, title, reached, *(section.text for section in sections)] if part)
    parts += [
        f"A run has *diverged* if {results.measure.diverged}; the rule uses "
        "only the validation split and was fixed beforehand. Means and contrasts are over converged runs, with the "
        "number of others beside them; the last column of each contrast counts diverged runs too.\n",
        f"## {results.measure.title}\n",
        cells_legend(results),
        cells.told().markdown(),
        runs_table(summaries).told().markdown(),
        beside_published(summaries, results),
    ]
    for name, table in compared.items():
        sides = results.plan.definition.get("contrasts", {}).get(name)
        title = f"{name}: {sides['treatment']} minus {sides['control']}" if sides else name
        if table.rows:
            parts += [
                f"## {title}\n",
                _legend([row for row in rows if row.contrast == name], results),
                table.told().markdown(),
            ]
        else:
            parts.append(f"## {title}\n\nNo pair of runs converged, so there is no difference to show.\n")
    if any(row.published == row.published for row in rows):
        parts += ["## What the published single runs can support\n", published_verdict(rows)]
    parts += [section.text for section in sections]
    return "\n".join(part for part in parts if part)


def _legend(rows: list[ContrastRow], results: SweepResults) -> str:
    measure, floor = results.measure, ""
    if any(row.floor for row in rows):
        floor = (
            "The noise floor is the mean difference between runs that differ only in their seeds, with its interval, "
            "and the spread of one such pair. "
        )
    return (
        f"{measure.difference.capitalize()}, {_pairing(results)}; {measure.better} is "
        f"better. {_stretches(results)}{floor}Intervals are {_method(results)}; p is of Wilcoxon's signed-rank test "
        "over pairs, "
        "two-sided, corrected by Holm over the conditions of one setting. *Dropped* pairs have a run that diverged, "
        "failed or is missing."
        + " ".join(["", *filter(None, [_least_p(rows, len(results.conditions)), footnotes(rows)])])
        + "\n"
    )


def _pairing(results: SweepResults) -> str:
    """What is paired, in words."""
    items = results.measure.items
    if results.replicate == "worlds":
        return f"paired by world: runs in one world are averaged before worlds are compared, each on its own {items}"
    return f"paired by seed, on the same test {items}"


def _stretches(results: SweepResults) -> str:
    """How neighbouring test items enter the sampling error, in words; empty where they do not."""
    if results.replicate == "worlds" or results.measure.statistic != "mean":
        return ""
    return f"For sampling error, the {results.measure.items} form {BLOCKS} blocks of neighbours, which are correlated. "


def _method(results: SweepResults) -> str:
    """How the interval of a contrast is computed, in words."""
    return "t intervals" + (", cut at a difference of 100" if results.measure.is_share else "")


def _least_p(rows: list[ContrastRow], conditions: int) -> str:
    """The smallest possible p: the signed-rank test of n pairs cannot give less than 2 / 2^n."""
    pairs = max((row.paired.seeds for row in rows if row.paired is not None), default=0)
    least = min(1.0, conditions * 2.0 ** (1 - pairs))
    if least <= 0.05 or pairs < 2:
        return ""
    return (
        f"With {pairs} pairs and {conditions} conditions no corrected p can be below {least:.3f}: read the intervals."
    )


def _forest_row(row: ContrastRow) -> ForestRow:
    paired, reach = row.paired, row.single_pair_reach
    assert paired is not None
    return ForestRow(
        row.condition.replace("_", " "), paired.mean, paired.low, paired.high, -reach, reach, row.published
    )


def _levels(conditions: list[str]) -> dict[str, list[float]]:
    levels: dict[str, list[float]] = {}
    for key in conditions:
        corruption, _, level = key.rpartition("/")
        if corruption and is_number(level):  # the name of a drive may contain a slash
            levels.setdefault(corruption, []).append(float(level))
    return levels


def _names(rows: list[ContrastRow]) -> list[str]:
    return list(dict.fromkeys(row.contrast for row in rows))


def _flat_row(row: ContrastRow) -> dict[str, object]:
    flat: dict[str, object] = {"contrast": row.contrast, "setting": row.setting, "condition": row.condition}
    for prefix, difference in (("", row.paired), ("floor_", row.floor)):
        fields = asdict(difference) if difference is not None else {}
        names = ("seeds", "mean", "spread", "low", "high", "image_low", "image_high", "p_value", "t_p_value", "wins")
        flat |= {prefix + name: fields.get(name, "") for name in names}
    return flat | {
        "dropped": row.dropped,
        "mean_with_diverged": row.everything,
        "p_holm": row.p_holm,
        "published": row.published,
    }


def _dates(results: SweepResults) -> str:
    """When the first and the last of the runs were started, in UTC; empty where their records do not say."""
    told = sorted(result.started for result in results.cells if not math.isnan(result.started))
    ends = [datetime.fromtimestamp(when, UTC).isoformat(timespec="seconds") for when in told] or [""]
    return TextTable(["first_run", "last_run"], [[ends[0], ends[-1]]]).csv()


def _csv(rows: list[dict[str, object]]) -> str:
    if not rows:
        return ""
    return TextTable(list(rows[0]), [[str(value) for value in row.values()] for row in rows]).csv()
