"""The page of a sweep in the tracking store, kept up to date while its runs end."""

import time
from collections.abc import Sequence
from pathlib import Path

from sextant.atomic_files import write_json
from sextant.errors import UserError
from sextant.lifecycle.claim_files import read_claims
from sextant.lifecycle.run_reporter import RunReporter
from sextant.recipes import recipe_of
from sextant.reports.results import Measured, SweepResults, read_results
from sextant.reports.sweep_page import Progress, sweep_page
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import SweepPlan
from sextant.tracking.mirror import MirroredRun
from sextant.tracking.sweep_parent import PAGE, PICTURES, artifact_address, label_cells, send_page

#: between two looks at the runs, unless the sweep has ended
EVERY_S = 20.0


class ParentPage:
    """Writes the page of a sweep's parent run: what it asks, how far it is, and what it has found.

    What goes wrong here is told once, and stops nothing.

    Args:
        parent: the MLflow run of the sweep.
        plan: of the sweep.
        outputs: folder that the runs of the plan are relative to.
        reporter: hears of a failure.
    """

    def __init__(self, parent: MirroredRun, plan: SweepPlan, outputs: Path, reporter: RunReporter):
        self.parent, self.plan, self.outputs, self.reporter = parent, plan, outputs, reporter
        self.directory = plan.directory(outputs)
        self.runs = [outputs / run for run in dict.fromkeys(cell.run for cell in plan.cells)]
        self.began, self.before = time.time(), self._done()
        self._looked, self._failed = 0.0, False
        self._named: set[str] = set()

    def look(self) -> None:
        """Write the page anew, if the last time is a while ago."""
        if time.monotonic() - self._looked > EVERY_S:
            self._try()
            self._looked = time.monotonic()

    def end(self, plan: SweepPlan) -> None:
        """Write the page as it stays, with the figures of the contrasts."""
        self.plan = plan
        self._try(ended=True)

    def _try(self, *, ended: bool = False) -> None:
        try:
            self._write(ended)
        except Exception as error:  # a page that cannot be written must not end the runs that it is about
            if not self._failed:
                self.reporter.say(f"the page of the sweep could not be written: {error}")
            self._failed = True

    def _write(self, ended: bool) -> None:
        done = self._done()
        try:
            results = read_results(self.directory, self.outputs, _measured) if done else None
        except UserError:  # none of those that ended was tested
            results = None
        pictures = [] if results is None or not ended else self._pictures(results)
        page = sweep_page(self.plan, self._progress(), results, pictures)
        tags = self._tags()
        self._named |= label_cells(self.parent, self.plan, self.outputs, tags, self._named)
        kept = {"text": page.text, "tags": tags, "params": self._params(), "metrics": page.metrics, "step": done}
        write_json(self.directory / PAGE, kept)
        send_page(self.parent, self.directory)

    def _tags(self) -> dict[str, str]:
        """The task, and the claims that the sweep decides."""
        rests = [name for name, claim in read_claims().items() if any(p.sweep == self.plan.name for p in claim.parts)]
        return {"task": self.plan.cells[0].run.split("/")[1], **({"claim": ", ".join(rests)} if rests else {})}

    def _params(self) -> dict[str, str]:
        """What is compared, in which settings, and over which seeds; of a search, what is searched and how."""
        cells = self.plan.cells
        if self.plan.is_search:
            search = self.plan.definition["search"]
            return {"search": str(search["method"]), **search["space"]}
        told = {
            "arms": [cell.arm for cell in cells],
            "settings": [cell.setting for cell in cells],
            "seeds": [str(cell.seed) for cell in cells],
        }
        return {name: ", ".join(dict.fromkeys(values)) for name, values in told.items()}

    def _pictures(self, results: SweepResults) -> Sequence[str]:
        from sextant.figures.style import save_figure
        from sextant.reports.contrasts import contrasts
        from sextant.reports.sweep_report import contrast_figures

        made = contrast_figures(results, contrasts(results))
        paths = [path for name, figure in made for path in save_figure(figure, self.directory / PICTURES, name)]
        return [artifact_address(f"{PICTURES}/{path.name}") for path in paths]

    def _progress(self) -> Progress:
        done = self._done()
        failures = {cell.run: cell.message for cell in self.plan.cells if cell.message}
        new = done - self.before
        left = (time.time() - self.began) / new * (len(self.runs) - done) if new else float("nan")
        return Progress(done, len(self.runs), failures, left)

    def _done(self) -> int:
        return sum(RunDirectory(run).metrics.is_file() for run in self.runs)


def _measured(task: str) -> Measured:
    return recipe_of(task).measured
