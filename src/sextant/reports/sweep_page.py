"""The page of a sweep for a dashboard: its question, its progress, and its findings."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from sextant.reports.contrasts import ContrastRow, contrast_table, contrasts, footnotes
from sextant.reports.divergence import divergence
from sextant.reports.results import SweepResults
from sextant.reports.search_results import leading_trial
from sextant.runs.sweep_directory import SweepPlan, report_command
from sextant.tables import TextTable, number

#: number of failures that are shown, and characters of each
MOST_FAILURES, LINE = 5, 200
#: largest numbers of table rows and of effects among the metrics; the report has all of them
MOST_ROWS, MOST_EFFECTS = 25, 12


@dataclass(frozen=True)
class Progress:
    """The progress of a sweep.

    Attributes:
        done: number of planned runs that have ended.
        planned: number of distinct runs.
        failures: error messages by run.
        left_s: estimate of the remaining time in seconds; nan while no run has ended.
    """

    done: int
    planned: int
    failures: dict[str, str] = field(default_factory=dict)
    left_s: float = float("nan")


def sweep_page(
    plan: SweepPlan, progress: Progress, results: SweepResults | None, outputs: Path, pictures: Sequence[str] = ()
) -> tuple[str, dict[str, float]]:
    """The text and the metrics of the page of a sweep.

    Args:
        plan: plan of the sweep.
        progress: progress of its runs.
        results: results of the runs that have ended; None while there are none.
        outputs: output folder of the sweep.
        pictures: addresses of the figures of its contrasts.
    """
    rows = [] if results is None else [row for row in contrasts(results) if row.paired is not None]
    ended = [] if results is None else results.cells
    diverged = len({result.cell.run for result in ended if result.outcome == "diverged"})
    parts = [f"**{plan.definition.get('question') or plan.title}**\n", _how_far(plan, progress, diverged)]
    found: dict[str, float] = {}
    if plan.is_search and results is not None:
        text, found = _best_so_far(results)
        parts += [text, *(f"![search]({address})\n" for address in pictures)]
    if results is not None and rows:
        told = f"{results.measure.difference.capitalize()}; {results.measure.better} is better."
        told += f" {notes}" if (notes := footnotes(rows[:MOST_ROWS])) else ""
        parts += [f"{told}\n", *(f"![contrast]({address})\n" for address in pictures)]
        parts.append(_table(rows[:MOST_ROWS], results))
    if results is not None and (told := divergence(results)):
        parts.append(f"{told}\n")
    if progress.failures:
        failed = list(progress.failures.items())[:MOST_FAILURES]
        parts.append("Failed:\n\n" + "".join(f"- `{run}`: {why[:LINE]}\n" for run, why in failed))
    commands = f"{plan.train_command}\n{report_command(plan.directory(outputs))}"
    parts.append(f"```\n{commands}\n```\n")
    metrics = {"runs/done": float(progress.done), "runs/planned": float(progress.planned)}
    metrics |= {"runs/failed": float(len(progress.failures)), "runs/diverged": float(diverged), **found}
    if progress.left_s == progress.left_s:
        metrics["minutes_left"] = progress.left_s / 60
    effects = [row for row in rows if row.contrast != plan.definition.get("noise_floor")]
    several = len({row.contrast for row in effects}) > 1
    for row in effects[:MOST_EFFECTS]:
        metrics |= _metrics(row, row.contrast if several else "")
    return "\n".join(parts), metrics


def outcomes_told(results: SweepResults) -> str:
    """The outcomes of the runs in words: ``5 finished, 1 diverged``."""
    counts = {name: results.count(name) for name in ("finished", "diverged", "failed", "missing")}
    return ", ".join(f"{count} {name}" for name, count in counts.items() if count)


def _how_far(plan: SweepPlan, progress: Progress, diverged: int) -> str:
    left = progress.left_s / 60
    told = f"; about {left:.0f} minutes left" if left == left and progress.done < progress.planned else ""
    ended = f"runs have ended, {diverged} of them diverged{told}.\n"
    if not plan.is_search:
        return f"{progress.done} of {progress.planned} {ended}"
    trials = len({cell.arm for cell in plan.cells})
    return f"{trials} of {plan.definition['search']['n_trials']} trials so far; {progress.done} {ended}"


def _best_so_far(results: SweepResults) -> tuple[str, dict[str, float]]:
    """The leading trial of a search, in words and as metrics."""
    leads, metric = leading_trial(results), str(results.plan.definition["search"]["metric"])
    if leads is None:
        return "No trial has a result yet.\n", {}
    run, mean, seeds = leads
    words = " ".join(f"{key}={value}" for key, value in run.cell.factors.items())
    over = f"mean of {seeds} seeds" if seeds > 1 else "one seed"
    name = metric.replace("/", " ")
    return f"Best: {run.cell.arm}, `{words}`, {metric} {number(mean)} ({over}).\n", {f"best/{name}": mean}


def _table(rows: Sequence[ContrastRow], results: SweepResults) -> str:
    columns = ["setting", "condition", "difference", f"95 % over {results.replicate}", "pairs", "p (Wilcoxon, Holm)"]
    body = [
        [name, *row]
        for name in dict.fromkeys(row.contrast for row in rows)
        for row in contrast_table(rows, name, results).only(columns).rows
    ]
    return TextTable(["contrast", *columns], body).told().markdown()


def _metrics(row: ContrastRow, contrast: str) -> dict[str, float]:
    """Metrics of a contrast under names that MLflow accepts (letters, digits, few signs); ``/`` ends a group's name."""
    paired = row.paired
    assert paired is not None
    words = [contrast, "" if row.setting == "-" else row.setting, row.condition.replace("/", " ")]
    name = re.sub(r"[^\w. -]+", "_", " ".join(word for word in words if word))
    found = {"effect": paired.mean, "low": paired.low, "high": paired.high, "p": row.p_holm}
    return {f"{kind}/{name}": value for kind, value in found.items() if value == value}
