"""The report of a sweep over several tasks: the headline figure of each, clean and by corruption, in one table.

Their figures have different units, so arms are compared by their loss relative to their own clean figure, and not by
contrasts.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sextant.chapters.classification.figures import by_family, corruption_heatmap
from sextant.evaluation import CORRUPTION_FAMILIES
from sextant.evaluation.headline import CLEAN, PREFIX, relative_loss
from sextant.reports.corruption_contrasts import OverSeeds
from sextant.reports.results import SweepResults
from sextant.reports.section import head, runs_planned, write_files
from sextant.tables import TextTable, number, with_interval

CORRUPTED = "corrupted"
UNDER = f"{PREFIX}/under/"


@dataclass(frozen=True)
class TaskRow:
    """One arm in one setting: a row of the table.

    Attributes:
        name: of the arm, with the setting if there are several.
        about: what the figure is, from the first run: ``name``, ``unit``, ``better``, ``test``, ``image_size``.
        values: by ``clean``, ``corrupted`` and corruption, the figure of each converged run.
        seeds: of these runs.
        planned: number of planned runs.
    """

    name: str
    about: Mapping[str, Any]
    values: Mapping[str, Sequence[float]]
    seeds: Sequence[int]
    planned: int

    @property
    def factor(self) -> float:
        """The factor by which a figure is multiplied for display."""
        return 100.0 if self.about.get("unit") == "%" else 1.0

    @property
    def title(self) -> str:
        """The figure with its unit."""
        unit = self.about.get("unit")
        return str(self.about.get("name", "–")) + (f", {unit}" if unit else "")

    def figure(self, of: str) -> OverSeeds:
        """The figure over seeds, as displayed."""
        return OverSeeds.of([self.factor * value for value in self.values.get(of, ())])

    def losses(self, of: str) -> list[float]:
        """The relative loss of each run against its own clean figure, in per cent; runs that have neither left out."""
        each = zip(self.values.get(CLEAN, ()), self.values.get(of, ()), strict=True)
        found = [100 * relative_loss(clean, value, self.about["better"]) for clean, value in each]
        return [loss for loss in found if loss == loss]

    @property
    def corruptions(self) -> list[str]:
        """Names of the corruptions."""
        return [name for name in self.values if name not in (CLEAN, CORRUPTED)]


def of_several_tasks(results: SweepResults) -> bool:
    """Whether the runs of a sweep are of several tasks, whose figures cannot be compared as they are."""
    return len({Path(cell.cell.run).parent.name for cell in results.cells}) > 1  # runs/<task>/<run>


def task_rows(results: SweepResults) -> list[TaskRow]:
    """A row for each setting and arm of the plan, with or without finished runs."""
    several = len(results.settings) > 1
    rows = []
    for setting in results.settings:
        for arm in results.arms:
            cells = results.of(setting, arm)
            told = [cell for cell in cells if cell.outcome == "finished" and cell.headline]
            names = {CLEAN: f"{PREFIX}/{CLEAN}", CORRUPTED: f"{PREFIX}/{CORRUPTED}"}
            names |= {n.removeprefix(UNDER): n for cell in told[:1] for n in cell.metrics if n.startswith(UNDER)}
            nan = float("nan")
            values = {of: [cell.metrics.get(name, nan) for cell in told] for of, name in names.items() if told}
            about = told[0].headline if told else {}
            seeds = [cell.cell.seed for cell in told]
            rows.append(TaskRow(f"{setting} {arm}" if several else arm, about, values, seeds, len(cells)))
    return rows


def write_tasks_report(results: SweepResults) -> list[Path]:
    """Write ``report/``: ``report.md``, ``tasks.csv``, ``task_seeds.csv``, ``tasks.tex``, a heat map of the losses."""
    folder = results.directory / "report"
    folder.mkdir(parents=True, exist_ok=True)
    rows = task_rows(results)
    table = overview_table(rows)
    texts = {
        "report.md": "\n".join(_markdown(results, rows, table)),
        "tasks.csv": _figures_of(rows).csv(),
        "task_seeds.csv": _seeds_of(rows).csv(),
        "tasks.tex": table.latex(),
    }
    figures, told = [], [row for row in rows if row.corruptions]
    if told:
        names = {name: name for name in _corruptions(told)} | {"mean": CORRUPTED}
        losses = {name: [_mean_loss(row, of) / 100 for row in told] for name, of in names.items()}
        figure = corruption_heatmap(
            losses,
            families=CORRUPTION_FAMILIES,
            levels=[row.name for row in told],
            title="loss against the clean figure, %",
            label="task",
            mean=False,
        )
        figures.append(("task_corruption_loss", figure))
    return write_files(folder, texts, figures)


def overview_table(rows: Sequence[TaskRow]) -> TextTable:
    """One row per task: the headline figure clean and corrupted, the loss, and the worst corruption."""
    columns = ["task", "figure", "images", "runs", "clean", "corrupted", "loss, %", "worst"]
    body = []
    for row in rows:
        size, losses = row.about.get("image_size") or [], OverSeeds.of(row.losses(CORRUPTED))
        worst = max(row.corruptions, key=lambda name: _or_least(_mean_loss(row, name)), default="")
        told = f"{worst.replace('_', ' ')} ({number(_mean_loss(row, worst), 0)} %)" if worst else "–"
        body.append(
            [
                row.name,
                row.title,
                "x".join(map(str, reversed(size))) or "–",
                f"{len(row.seeds)} of {row.planned}",
                *(with_interval(row.figure(of), alone=True) for of in (CLEAN, CORRUPTED)),
                with_interval(losses, 1, alone=True),
                told,
            ]
        )
    return TextTable(columns, body)


def loss_table(rows: Sequence[TaskRow]) -> TextTable:
    """One row per corruption, one column per task: the relative loss in per cent, its mean over runs."""
    body = []
    for _, members in by_family(dict.fromkeys(_corruptions(rows)), CORRUPTION_FAMILIES):
        body += [[name.replace("_", " "), *(number(_mean_loss(row, name), 1) for row in rows)] for name in members]
    body.append(["**mean**", *(f"**{number(_mean_loss(row, CORRUPTED), 1)}**" for row in rows)])
    return TextTable(["corruption", *(row.name for row in rows)], body)


def _markdown(results: SweepResults, rows: Sequence[TaskRow], table: TextTable) -> Iterator[str]:
    yield from head(results)
    yield runs_planned(results, "task")
    tests = sorted({str(row.about["test"]) for row in rows if "test" in row.about})
    yield "## Tasks under corruptions\n"
    yield (
        "The headline figure of each task on clean test images, and its mean over severities and then over corruptions "
        f"({'; '.join(tests) or 'none'}), drawn at the given size of the images. *Loss* is the change "
        "for the worse relative to the clean figure: an error may grow by more than 100 %. Means "
        "over converged runs with 95 % t intervals over seeds. **Tasks differ in data, image size and figure: a loss "
        "compares corruptions within a task, and only roughly tasks with one another.**\n"
    )
    yield table.markdown()
    told = [row for row in rows if row.corruptions]
    if told:
        yield "## Loss by corruption, %\n"
        yield "![loss by corruption and task](task_corruption_loss.png)\n"
        yield loss_table(told).markdown()


def _corruptions(rows: Sequence[TaskRow]) -> list[str]:
    return list(dict.fromkeys(name for row in rows for name in row.corruptions))


def _mean_loss(row: TaskRow, of: str) -> float:
    return OverSeeds.of(row.losses(of)).mean if of in row.values else float("nan")


def _or_least(value: float) -> float:
    return value if value == value else float("-inf")


def _figures_of(rows: Sequence[TaskRow]) -> TextTable:
    columns = ["task", "figure", "better", "corruption", "runs", "mean", "spread", "low", "high"]
    columns += ["loss", "loss_low", "loss_high"]
    body = []
    for row in rows:
        for name in row.values:
            found, loss = row.figure(name), OverSeeds.of(row.losses(name))
            values = (found.mean, found.spread, found.low, found.high, loss.mean, loss.low, loss.high)
            body.append([row.name, row.title, row.about["better"], name, str(len(row.seeds)), *map(str, values)])
    return TextTable(columns, body)


def _seeds_of(rows: Sequence[TaskRow]) -> TextTable:
    body = [
        [row.name, str(seed), name, str(row.factor * value)]
        for row in rows
        for name, values in row.values.items()
        for seed, value in zip(row.seeds, values, strict=True)
    ]
    return TextTable(["task", "seed", "corruption", "value"], body)
