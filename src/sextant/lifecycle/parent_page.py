"""The page of a sweep in the tracking store, kept up to date as its runs end."""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from sextant.atomic_files import read_json, write_json
from sextant.errors import UserError
from sextant.lifecycle.claim_files import read_claims
from sextant.lifecycle.run_reporter import RunReporter
from sextant.registry import chapter_of
from sextant.reports.results import Measured, SweepResults, read_results
from sextant.reports.sweep_page import Progress, outcomes_told, sweep_page
from sextant.runs.directory import RunDirectory
from sextant.runs.locks import LockedError, run_lock
from sextant.runs.sweep_directory import SweepPlan, read_plan, read_plans
from sextant.tracking.mirror import MirroredRun, ended_at
from sextant.tracking.refill import refill
from sextant.tracking.store import Store
from sextant.tracking.sweep_parent import (
    DONE,
    PAGE,
    PICTURES,
    PRESENT,
    VERSION,
    artifact_address,
    label_cells,
    send_page,
)

#: seconds between two checks of the runs, unless the sweep has ended
EVERY_S = 20.0


class ParentPage:
    """Writes the page of a sweep's parent run: its question, its progress, and its findings so far.

    An error in writing the page is reported once and stops nothing.

    Args:
        parent: the MLflow run of the sweep.
        plan: plan of the sweep.
        outputs: folder that the runs of the plan are relative to.
        reporter: receives a message about a failure.
    """

    def __init__(self, parent: MirroredRun, plan: SweepPlan, outputs: Path, reporter: RunReporter):
        self.parent, self.plan, self.outputs, self.reporter = parent, plan, outputs, reporter
        self.directory = plan.directory(outputs)
        self.runs = _runs(plan, outputs)
        self.began, self.before = time.time(), _done(self.runs)
        self._looked, self._failed = 0.0, False
        self._named: set[str] = set()

    def look(self) -> None:
        """Rewrite the page if the last check is more than :data:`EVERY_S` ago."""
        if time.monotonic() - self._looked > EVERY_S:
            self._try()
            self._looked = time.monotonic()

    def end(self, plan: SweepPlan) -> None:
        """Write the final page, with the figures of the contrasts."""
        self.plan = plan
        self._try(ended=True)

    def _try(self, *, ended: bool = False) -> None:
        try:
            self._write(ended)
        except Exception as error:  # a page that cannot be written must not end its runs
            if not self._failed:
                self.reporter.say(f"the page of the sweep could not be written: {error}")
            self._failed = True

    def _write(self, ended: bool) -> None:
        tags = write_page(self.plan, self.outputs, left_s=self._left_s(), ended=ended)
        self._named |= label_cells(self.parent, self.plan, self.outputs, tags, self._named)
        send_page(self.parent, self.directory)

    def _left_s(self) -> float:
        if self.plan.is_search:  # the number of runs depends on their results
            return float("nan")
        done = _done(self.runs)
        new = done - self.before
        return (time.time() - self.began) / new * (len(self.runs) - done) if new else float("nan")


def write_page(plan: SweepPlan, outputs: Path, *, left_s: float = float("nan"), ended: bool = True) -> dict[str, str]:
    """Write the page of a sweep's parent run into the sweep's directory.

    Args:
        plan: plan of the sweep.
        outputs: folder that the runs of the plan are relative to.
        left_s: estimate of the remaining time, in seconds.
        ended: whether to include the figures of the contrasts.

    Returns:
        The page's tags, which its runs share.
    """
    directory, runs = plan.directory(outputs), _runs(plan, outputs)
    done = _done(runs)
    try:
        results = read_results(directory, outputs, _measured) if done else None
    except UserError:  # none of the ended runs was tested
        results = None
    pictures = [] if results is None or not ended else _pictures(results, directory)
    failures = {cell.run: cell.message for cell in plan.cells if cell.message}
    progress, tags = Progress(done, len(runs), failures, left_s), _tags(plan)
    text, metrics = sweep_page(plan, progress, results, outputs, pictures)
    own = {VERSION: PRESENT, **({} if results is None else {"sextant.outcome": outcomes_told(results)})}
    kept = {
        "text": text,
        "tags": tags,
        "own_tags": own,
        "params": _params(plan),
        "metrics": metrics,
        "step": done,
    }
    write_json(directory / PAGE, kept)
    return tags


def fill_store(store: Store, outputs: Path, reporter: RunReporter) -> int:
    """Write the pages of sweeps that ended unobserved, and bring a store up to date with the run directories.

    Args and raises:
        As :func:`~sextant.tracking.refill.refill`, here for every run, whichever store it logs to.

    Returns:
        The number of runs and parents of sweeps that were created or repaired.
    """
    for directory in read_plans(outputs):
        try:
            with run_lock(outputs / "sweeps", directory.name, wait=False):
                _renew(read_plan(directory), outputs)
        except LockedError:
            continue
        except Exception as error:  # an unreadable sweep must not keep the runs from the store
            reporter.say(f"the page of {directory.name} could not be written: {error}")
    return refill(store, outputs, reporter=reporter)


def _renew(plan: SweepPlan, outputs: Path) -> None:
    """Write the page of a sweep that no process runs, unless it already counts all runs that have ended."""
    if not plan.cells:
        return
    page, runs = read_json(plan.directory(outputs) / PAGE), _runs(plan, outputs)
    closed = plan.ended or _done(runs) < len(runs)
    if not closed:  # its last run ended on a cluster while no process waited for it
        plan = replace(plan, ended=max(ended_at(RunDirectory(run)) for run in runs))
        plan.write(outputs)
    is_present = page is not None and page.get("own_tags", {}).get(VERSION) == PRESENT
    if not closed or page is None or not is_present or page["metrics"].get(DONE) != _done(runs):
        write_page(plan, outputs)


def _tags(plan: SweepPlan) -> dict[str, str]:
    """The task, and the claims that the sweep decides."""
    rests = [name for name, claim in read_claims().items() if any(p.sweep == plan.name for p in claim.parts)]
    return {"task": plan.cells[0].run.split("/")[1], **({"claim": ", ".join(rests)} if rests else {})}


def _params(plan: SweepPlan) -> dict[str, str]:
    """The arms, settings and seeds of a sweep; for a search, its method and space."""
    if plan.is_search:
        search = plan.definition["search"]
        return {"search": str(search["method"]), **search["space"]}
    told = {
        "arms": [cell.arm for cell in plan.cells],
        "settings": [cell.setting for cell in plan.cells],
        "seeds": [str(cell.seed) for cell in plan.cells],
    }
    return {name: ", ".join(dict.fromkeys(values)) for name, values in told.items()}


def _pictures(results: SweepResults, directory: Path) -> Sequence[str]:
    from sextant.figures.style import save_figure
    from sextant.reports.contrasts import contrasts
    from sextant.reports.search_report import search_figures
    from sextant.reports.search_results import search_results
    from sextant.reports.sweep_report import contrast_figures

    if results.plan.is_search:
        made = search_figures(search_results(results)) if (directory / "search.json").exists() else []
    else:
        made = contrast_figures(results, contrasts(results))
    titles = _titles(results)
    for name, figure in made:  # a panel's title is that of its setting
        figure.suptitle(titles.get(name, name), fontsize=9)
    paths = [path for name, figure in made for path in save_figure(figure, directory / PICTURES, name)]
    return [artifact_address(f"{PICTURES}/{path.name}") for path in paths]


def _titles(results: SweepResults) -> dict[str, str]:
    """The titles of the figures of a page, by their names."""
    from sextant.reports.contrasts import named_contrasts
    from sextant.tables import slug

    told = {"history": "trials of the search", "importances": "importance of each key"}
    for name, contrast in named_contrasts(results).items():
        told[f"contrast_{slug(name)}"] = f"{name}: {contrast['treatment']} minus {contrast['control']}"
    return told


def _runs(plan: SweepPlan, outputs: Path) -> list[Path]:
    return [outputs / run for run in dict.fromkeys(cell.run for cell in plan.cells)]


def _done(runs: Sequence[Path]) -> int:
    return sum(RunDirectory(run).metrics.is_file() for run in runs)


def _measured(task: str) -> Measured:
    measured: Measured = chapter_of(task).measured
    return measured
