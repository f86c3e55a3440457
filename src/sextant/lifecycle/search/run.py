"""Running a search: ask for trials, give further seeds to the promising ones, test the winner."""

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sextant.atomic_files import write_json
from sextant.composing.compose import composing_many
from sextant.composing.config_files import with_folders
from sextant.config import Config
from sextant.config.schema.launchers import SlurmLauncher
from sextant.errors import UserError
from sextant.evaluation.racing import every, halving, racing, seeds_run
from sextant.lifecycle.checks import require_environment
from sextant.lifecycle.execute import fill_if_behind
from sextant.lifecycle.launchers import launch, require_launcher
from sextant.lifecycle.launchers.cells import CANCELLED, Cells, Outcomes
from sextant.lifecycle.run_reporter import SILENT_RUN, RunReporter
from sextant.lifecycle.search.design import SearchDesign, read_search
from sextant.lifecycle.search.table import Table, Trial, arm_of
from sextant.lifecycle.sweep import Launch, SweepOutcome, cell_outcome, missing_cells, run_missing, run_sweep
from sextant.lifecycle.sweep_plan import Planned
from sextant.runs.directory import RunDirectory
from sextant.runs.locks import run_lock
from sextant.runs.sweep_directory import SweepPlan, attach_command
from sextant.tables import counted

if TYPE_CHECKING:
    from sextant.lifecycle.search.study import Asked, Study


def sweep_or_search(
    arguments: Sequence[str],
    reporter: RunReporter = SILENT_RUN,
    *,
    runs: RunReporter = SILENT_RUN,
    wait: bool | None = None,
    run_cells: Launch | None = None,
) -> SweepOutcome:
    """Run the sweep that overrides describe, or the search if they set ``sweep.search``.

    Args and raises:
        As :func:`~sextant.lifecycle.sweep.run_sweep`.
    """
    with composing_many():
        found = read_search(arguments)
        if found is not None:
            return run_search(*found, reporter, runs=runs, run_cells=run_cells)
    return run_sweep(arguments, reporter, runs=runs, wait=wait, run_cells=run_cells)


def run_search(
    design: SearchDesign,
    config: Config,
    reporter: RunReporter = SILENT_RUN,
    *,
    runs: RunReporter = SILENT_RUN,
    run_cells: Launch | None = None,
) -> SweepOutcome:
    """Run the missing runs of a search: its trials, then the winner at the fresh seeds.

    Args:
        design: design of the search.
        config: config in the middle of its space.
        reporter: listens to the search.
        runs: listens to its runs, in the processes that compute them.
        run_cells: runs cells instead of the config's launcher.

    Raises:
        UserError: the storage holds another search, or the launcher cannot be used.
    """
    from sextant.lifecycle.search.study import Study

    if isinstance(config.launcher, SlurmLauncher) and not config.launcher.wait:
        reporter.say("launcher.wait=false: a search waits nevertheless, as its next trials depend on earlier results")
        config = config.model_copy(update={"launcher": config.launcher.model_copy(update={"wait": True})})
    require_environment(config, reporter)
    require_launcher(config)
    outputs = Path(config.paths.outputs).absolute()
    directory = _plan(design, config).directory(outputs)
    run_cells = run_cells or partial(launch, config=config, folder=directory, reporter=reporter, runs=runs)
    with run_lock(outputs / "sweeps", directory.name, wait=False, lease_s=config.launcher.lease_s):
        search = _Search(design, config, outputs, Study(design, directory), run_cells, reporter)
        search.run()
    plan = search.plan
    fill_if_behind(config, [RunDirectory(outputs / cell.run) for cell in plan.cells], reporter)
    outcomes = [cell_outcome(cell, outputs, reused=cell.run not in search.started, left=False) for cell in plan.cells]
    return SweepOutcome(plan.name, directory, tuple(plan.cells), tuple(outcomes))


def _plan(design: SearchDesign, config: Config) -> SweepPlan:
    tracking = {"kind": config.tracking.kind, "uri": config.tracking.uri}
    return SweepPlan(
        design.name, design.definition, with_folders(design.arguments), [], [], tracking, time.time(), key=design.digest
    )


class _Search:
    """A search in progress. The storage holds its trials, the run directories hold their results."""

    def __init__(
        self,
        design: SearchDesign,
        config: Config,
        outputs: Path,
        study: "Study",
        run_cells: Launch,
        reporter: RunReporter,
    ):
        self.design, self.config, self.outputs = design, config, outputs
        self.study, self.run_cells, self.reporter = study, run_cells, reporter
        self.started: set[str] = set()
        self.table = Table(design, outputs)
        self.plan = _plan(design, config).resumed(outputs)
        self.told: set[int] = set()
        for asked in study.trials():
            self._add(asked)
        self.plan = replace(self.plan, cells=self.table.cells([]))
        self.plan.write(outputs)

    def run(self) -> None:
        """Ask for trials, run them and report back until all are settled; then test the winner."""
        self.reporter.planned(self.plan, sum(self._finished(cell.run) for cell in self.plan.cells))
        while batch := self._next():
            self._launch(batch)
        best = self.table.best()
        if best is not None:
            fresh = best.planned[len(self.design.seeds) :]
            self._launch([entry for entry in fresh if not self._finished(entry.cell.run)])
        self._summarise(best)
        if self.plan.began and not self.plan.ended:
            self.plan, _ = run_missing(self.plan, [], self.config, self.outputs, self.run_cells, self.reporter)

    def _next(self) -> list[Planned]:
        """The runs to start together: one more seed for each promising trial, and new trials beside them.

        A sampler's next point depends on the recorded results, so all known ones are recorded first.
        """
        while True:
            self._tell_settled()
            batch = [self.table.trials[number].planned[place] for number, place in self._deserving()]
            if len(batch) >= self.design.search.parallel or len(self.table.trials) >= self.design.trials:
                return batch
            self._add(self.study.ask())

    def _deserving(self) -> list[tuple[int, int]]:
        """The trials that get another seed, by number, with the index of that seed."""
        search, scores = self.design.search, self.table.scores()
        if not len(scores):
            return []
        if search.method == "halving":
            chosen = halving(scores, self.design.trials)
        else:
            last = len(scores) >= self.design.trials
            chosen = racing(scores, search.confidence, last=last) if search.race else every(scores)
        counts = seeds_run(scores)
        return [(number, int(counts[number])) for number in chosen]

    def _launch(self, batch: list[Planned]) -> None:
        if not batch:
            return
        self.plan = replace(self.plan, cells=self.table.cells(batch))
        missing = missing_cells([replace(entry, finished=False) for entry in batch], self.outputs)
        self.started |= {entry.cell.run for entry in batch}
        self.plan, _ = run_missing(
            self.plan, missing, self.config, self.outputs, self._run_cells, self.reporter, last=False
        )
        self.table.failed |= {cell.run: cell.message for cell in self.plan.cells if cell.message}

    def _run_cells(self, cells: Cells) -> Outcomes:
        """Run cells; raise an error if the user cancels the search, as that is neither a result nor a failed trial."""
        outcomes = self.run_cells(cells)
        if any(how is not None and how["message"] == CANCELLED for how in outcomes):
            folder = self.plan.directory(self.outputs)
            told = f"The same command, or {attach_command(folder)}, continues it."
            raise UserError(f"{folder.name} was cancelled", told)
        return outcomes

    def _tell_settled(self) -> None:
        """Record in the storage which trials get no further seed."""
        scores = self.table.scores()
        waiting = {number for number, _ in self._deserving()}
        for trial, row in zip(self.table.trials, scores, strict=True):
            if trial.number in self.told or trial.number in waiting or np.isnan(row).all():
                continue
            self.told.add(trial.number)
            if np.isneginf(row).any():
                diverged = self.table.diverged(trial)
                self.study.tell(trial.number, None, diverged=diverged)
                self.reporter.settled(trial.number, trial.setting, None, "diverged" if diverged else "failed")
            else:
                value = self.design.sign * float(np.nanmean(row))
                self.study.tell(trial.number, value)
                self.reporter.settled(trial.number, trial.setting, value, counted(int((~np.isnan(row)).sum()), "seed"))

    def _add(self, asked: "Asked") -> Trial:
        try:
            planned, problem = self.design.planned(arm_of(asked.number), asked.setting, self.reporter), ""
        except UserError as error:
            planned, problem = [], error.problem
        trial = Trial(asked.number, asked.setting, planned, problem)
        self.table.trials.append(trial)
        if asked.told:
            self.told.add(asked.number)
        return trial

    def _finished(self, run: str) -> bool:
        return RunDirectory(self.outputs / run).metrics.is_file()

    def _summarise(self, best: Trial | None) -> None:
        """Write what a report needs in addition to the plan and the run directories."""
        from sextant.lifecycle.search.study import importances

        scores, folder = self.table.scores(), self.plan.directory(self.outputs)
        self.plan = replace(self.plan, cells=self.table.cells([]))
        self.plan.write(self.outputs)
        valued = [(t, row) for t, row in zip(self.table.trials, scores, strict=True) if np.isfinite(np.nanmean(row))]
        means = [self.design.sign * float(np.nanmean(row)) for _, row in valued]
        found = {
            "trials": [
                {"number": t.number, "setting": dict(t.setting), "problem": t.problem} for t in self.table.trials
            ],
            "winner": None if best is None else best.number,
            "importances": importances([t.setting for t, _ in valued], means, self.design),
        }
        write_json(folder / "search.json", found)
