"""The report of a sweep or a search as an HTML page."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from sextant.atomic_files import write_atomically
from sextant.evaluation.verdict import Replicate
from sextant.figures.charts import Spec
from sextant.figures.interval_chart import IntervalRow, interval_chart
from sextant.figures.searches import TrialMark, search_chart
from sextant.reports.contrasts import ContrastRow, contrasts
from sextant.reports.page.html_page import html_page
from sextant.reports.results import SweepResults
from sextant.reports.search_results import search_results
from sextant.reports.section import Summary, summarise
from sextant.reports.tasks_report import of_several_tasks
from sextant.tables import interval, number


def write_report_page(results: SweepResults, folder: Path) -> Path:
    """Write the HTML page of an existing report: charts of the results, then the report's text and pictures.

    Args:
        results: results of the runs.
        folder: folder for the page, which is named after the sweep's directory.

    Returns:
        The path of the page.
    """
    path = folder / f"{results.directory.name}.html"
    text = _page(results, results.directory / "report")
    write_atomically(path, lambda file: file.write(text.encode()))
    return path


def _page(results: SweepResults, report: Path) -> str:
    text = (report / "report.md").read_text("utf-8")
    head, between, rest = text.partition("\n## ")
    if results.plan.is_search:
        return html_page(results.plan.title, text, {"history": [_search(results)]}, report)
    if of_several_tasks(results):
        return html_page(results.plan.title, text, {}, report)
    charts = {"arms": list(_arms(results, summarise(results))), "contrasts": list(_contrasts(results))}
    shown = "".join(f"\n![{name}]({name}.svg)\n" for name, specs in charts.items() if specs)
    return html_page(results.plan.title, head + shown + between + rest, charts, report)


def _arms(results: SweepResults, summaries: Sequence[Summary]) -> Iterator[Spec]:
    """The means of the arms under each condition, one chart per setting."""
    measure = results.measure
    for setting in results.settings:
        rows = [
            _arm(row, measure.digits, results.replicate)
            for condition in results.conditions
            for row in summaries
            if (row.setting, row.condition) == (setting, condition) and row.seeds
        ]
        if not rows:
            continue
        axis = f"{measure.quantity}{f' ({measure.unit})' if measure.unit else ''}; {measure.better} is better"
        yield interval_chart(rows, axis, _title("Arms", setting), order=results.arms, marks=())


def _arm(row: Summary, digits: int, replicate: Replicate) -> IntervalRow:
    tip = {
        "arm": row.arm,
        "condition": row.condition,
        "mean": number(row.mean, digits),
        f"95 % over {replicate}": interval(row.low, row.high, digits),
        "runs": f"{row.seeds} converged, {row.diverged} diverged, {row.failed} failed, {row.missing} missing",
    }
    return IntervalRow(row.condition, row.mean, row.low, row.high, row.arm, published=row.published, tip=tip)


def _contrasts(results: SweepResults) -> Iterator[Spec]:
    """The differences under each condition, one chart per contrast and setting."""
    rows, digits = [row for row in contrasts(results) if row.paired is not None], results.measure.digits
    axis = f"{results.measure.difference}; {results.measure.better} is better"
    for name, setting in dict.fromkeys((row.contrast, row.setting) for row in rows):
        of_chart = [
            _contrast(row, digits, results.replicate) for row in rows if (row.contrast, row.setting) == (name, setting)
        ]
        yield interval_chart(of_chart, axis, _title(name, setting))


def _contrast(row: ContrastRow, digits: int, replicate: Replicate) -> IntervalRow:
    paired, reach = row.paired, row.single_pair_reach
    assert paired is not None
    mean, low, high = paired.mean, paired.low, paired.high
    tip = {
        "condition": row.condition,
        "difference": number(mean, digits, sign=True),
        f"95 % over {replicate}": interval(low, high, digits, sign=True),
        "pairs": str(paired.seeds),
        "p (Wilcoxon, Holm)": number(row.p_holm, 3),
        "one pair of runs, seeds alone": interval(-reach, reach, digits, sign=True),
    }
    return IntervalRow(row.condition, mean, low, high, f"mean over {replicate}", (-reach, reach), row.published, tip)


def _search(results: SweepResults) -> Spec:
    found = search_results(results)
    metric = str(found.search["metric"])
    trials = [
        TrialMark(
            trial.number,
            trial.mean,
            trial.state,
            {"trial": str(trial.number), metric: f"{trial.mean:.4g}", "seeds": str(len(trial.values)), **trial.setting},
        )
        for trial in found.trials
    ]
    return search_chart(trials, metric, "Trials")


def _title(name: str, setting: str) -> str:
    return name if setting == "-" else f"{name}: {setting}"
