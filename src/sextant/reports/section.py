"""A part of a report: text, tables as files, and pictures."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sextant.atomic_files import write_atomically
from sextant.evaluation.verdict import LEAST
from sextant.reports.results import SweepResults
from sextant.runs.sweep_directory import report_command
from sextant.tables import counted

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Summary:
    """The measure of one setting and arm under one condition, over converged seeds.

    ``all_mean`` includes diverged runs.
    """

    setting: str
    arm: str
    condition: str
    seeds: int
    diverged: int
    failed: int
    missing: int
    mean: float
    median: float
    spread: float
    low: float
    high: float
    all_mean: float
    published: float


def summarise(results: SweepResults) -> list[Summary]:
    """Summarise all cells under all conditions; nan where there is nothing to summarise."""
    rows = []
    for setting in results.settings:
        for arm in results.arms_of(setting):
            cells = results.of(setting, arm)
            converged = [cell for cell in cells if cell.outcome == "finished"]
            diverged = [cell for cell in cells if cell.outcome == "diverged"]
            for condition in results.conditions:
                values = np.array([cell.value(condition) for cell in converged])
                everything = [c.value(condition) for c in cells if c.values]
                low, high = results.measure.interval(values, sum(len(cell.values[condition]) for cell in converged))
                rows.append(
                    Summary(
                        setting=setting,
                        arm=arm,
                        condition=condition,
                        seeds=len(converged),
                        diverged=len(diverged),
                        failed=sum(cell.outcome == "failed" for cell in cells),
                        missing=sum(cell.outcome == "missing" for cell in cells),
                        mean=float(values.mean()) if len(values) else float("nan"),
                        median=float(np.median(values)) if len(values) else float("nan"),
                        spread=float(values.std(ddof=1)) if len(values) > 1 else float("nan"),
                        low=low,
                        high=high,
                        all_mean=float(np.mean(everything)) if everything else float("nan"),
                        published=results.published(setting, arm, condition),
                    )
                )
    return rows


@dataclass(frozen=True)
class Section:
    """What one part adds to a report.

    Attributes:
        text: Markdown, with its heading; empty if there is nothing to say.
        files: contents of further files, by name.
        figures: named pictures to write beside the text.
    """

    text: str = ""
    files: Mapping[str, str] = field(default_factory=dict)
    figures: "Sequence[tuple[str, Figure]]" = ()


def head(results: SweepResults) -> list[str]:
    """Title, question and commands of a report."""
    plan = results.plan
    question = plan.definition.get("question")
    commands = f"`{plan.train_command}`, then `{report_command(results.directory)}`\n"
    return [f"# {plan.title}\n", *([f"{question}\n"] if question else []), commands]


def runs_planned(results: SweepResults, of: str) -> str:
    """The numbers of runs by their outcome, and of the seeds (and worlds) of each cell or task, named in ``of``."""
    counts = ", ".join(f"{results.count(name)} {name}" for name in ("finished", "diverged", "failed", "missing"))
    seeds = len({result.cell.pair for result in results.cells})
    worlds, least = len({result.cell.world for result in results.cells}), LEAST[results.replicate]
    enough = (worlds if results.replicate == "worlds" else seeds) >= least
    few = "" if enough else f" **Exploratory**: a claim needs {least} {results.replicate}."
    drawn = counted(seeds, "seed") if results.replicate == "seeds" else f"{seeds} in {counted(worlds, 'world')}"
    return f"{counted(len(results.cells), 'run')} planned: {counts}. {drawn} a {of}.{few}\n"


def write_files(folder: Path, texts: Mapping[str, str], figures: "Iterable[tuple[str, Figure]]") -> list[Path]:
    """Write texts and named figures into a folder and return the paths; a figure as PNG and SVG."""
    from sextant.figures.style import save_figure

    for name, text in texts.items():
        write_atomically(folder / name, lambda file, text=text: file.write(text.encode()))  # type: ignore[misc]
    paths = [folder / name for name in texts]
    for name, figure in figures:
        paths += save_figure(figure, folder, name, formats=("png", "svg"))
    return paths
