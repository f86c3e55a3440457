"""The directory of a sweep: its planned cells and the locations of their runs."""

import hashlib
import json
import os
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from sextant.atomic_files import read_json, write_json
from sextant.errors import UserError, command
from sextant.reporter import SILENT, Reporter
from sextant.runs.directory import RunDirectory
from sextant.runs.outputs_folder import conf_dir, other_than_default

#: names of sweeps and searches that the command line defines
UNNAMED = ("sweep", "search")


@dataclass(frozen=True)
class Cell:
    """One planned run of a sweep.

    Attributes:
        factors: the setting that this cell shares with the cells it is compared to.
        arm: name of the compared arm.
        pair: index of the seed in the sweep's list, or of the world and seed; cells of one pair are compared with each
            other.
        seed: the seed of the run: that of the pair plus the arm's offset.
        digest: digest of its config.
        run: its run directory, relative to the output folder.
        message: why it failed; empty if it did not.
        world: the world it ran in, the replicate of the sweep; empty if seeds are.
    """

    factors: dict[str, str]
    arm: str
    pair: int
    seed: int
    digest: str
    run: str
    message: str = ""
    world: str = ""

    @property
    def setting(self) -> str:
        """The values of the factors, such as ``lenet_a``; ``-`` without factors."""
        return ", ".join(self.factors.values()) or "-"


@dataclass(frozen=True)
class SweepPlan:
    """The plan of a sweep: what it runs and how to read it; the content of ``cells.json``.

    Attributes:
        definition: the ``sweep`` node of the config.
        command: the overrides it was called with.
        cells: every planned run.
        mlflow_runs: the parent runs that mirror or have mirrored it, newest last.
        tracking: kind and address of the store that holds them.
        started: when it was last run, in seconds since 1970.
        began: when its first run was started; 0 if none has been.
        ended: when its last run had ended; 0 while runs go on, and if it was killed.
        key: identity of a search, which keeps its directory while cells are added; empty otherwise.
        here: the folder from which relative paths in its command start.
    """

    name: str
    definition: dict[str, Any]
    command: list[str]
    cells: list[Cell]
    mlflow_runs: list[str] = field(default_factory=list)
    tracking: dict[str, str | None] = field(default_factory=dict)
    started: float = 0.0
    began: float = 0.0
    ended: float = 0.0
    key: str = ""
    here: str = field(default_factory=os.getcwd)

    @property
    def digest(self) -> str:
        """The key of a search, otherwise the SHA-256 of the planned runs, independent of their location."""
        if self.key:
            return self.key
        cells = sorted([cell.setting, cell.arm, cell.pair, cell.seed, cell.digest] for cell in self.cells)
        return hashlib.sha256(json.dumps(cells).encode()).hexdigest()

    @property
    def title(self) -> str:
        """The name of a stored sweep; of one that the command line defined, what it compares."""
        if self.name not in UNNAMED:
            return self.name
        if self.is_search:
            return f"search of {', '.join(self.definition['search']['space'])}"
        arms = self.definition.get("arms") or {}
        keys = {word.partition("=")[0] for arm in arms.values() for word in arm["overrides"]}
        compared = f"{'/'.join(sorted(keys))}: {', '.join(arms)}" if arms else "seeds of one config"
        factors = self.cells[0].factors if self.cells else {}
        return " by ".join([compared, *([", ".join(factors)] if factors else [])])

    @property
    def is_search(self) -> bool:
        """Whether its cells are trials of a search."""
        return bool(self.definition.get("search"))

    @property
    def own_words(self) -> list[str]:
        """The overrides that it was called with, except the choice of a block."""
        return [word for word in self.command if "sweep.block=" not in word]

    @property
    def train_command(self) -> str:
        """The command that runs it, with all of its blocks."""
        return command("train", "-m", *self.own_words)

    def directory(self, outputs: Path) -> Path:
        """``outputs/sweeps/<name>-<digest8>``."""
        return outputs / "sweeps" / f"{self.name}-{self.digest[:8]}"

    def write(self, outputs: Path) -> Path:
        """Write ``cells.json`` and return the sweep's directory."""
        directory = self.directory(outputs)
        write_json(directory / "cells.json", asdict(self))
        return directory

    def resumed(self, outputs: Path) -> "SweepPlan":
        """This plan with the parent runs, times and failures of the plan stored in its directory, if that can be read.

        A failure is forgotten once the run has results.
        """
        try:
            before = read_plan(self.directory(outputs))
        except UserError:  # not begun before, or damaged: the name of the directory identifies the plan
            return self
        told = [cell for cell in before.cells if cell.message]
        failed = {cell.run: cell.message for cell in told if RunDirectory(outputs / cell.run).results() is None}
        cells = [replace(cell, message=failed.get(cell.run, "")) for cell in self.cells]
        return replace(self, cells=cells, mlflow_runs=before.mlflow_runs, began=before.began, ended=before.ended)


def read_plan(directory: Path) -> SweepPlan:
    """Read the plan in a sweep's directory.

    Raises:
        UserError: the plan is missing or damaged.
    """
    found: Any = read_json(directory / "cells.json")
    try:
        return SweepPlan(**{**found, "cells": [Cell(**cell) for cell in found["cells"]]})
    except (TypeError, KeyError):
        raise UserError(
            f"{directory}/cells.json is missing or damaged", "Run the sweep again: finished runs are kept."
        ) from None


def read_plans(outputs: Path, reporter: Reporter = SILENT) -> dict[Path, SweepPlan]:
    """Read the plans of all sweeps, by directory; damaged plans are reported and skipped."""
    found: dict[Path, SweepPlan] = {}
    for directory in sorted(file.parent for file in outputs.glob("sweeps/*/cells.json")):
        try:
            found[directory] = read_plan(directory)
        except UserError as error:
            reporter.say(f"{error.problem}, and is skipped")
    return found


def report_command(directory: Path) -> str:
    """The command that reports on the sweep in a directory, with its output folder unless that is the default."""
    return command("report", f"sweep={directory.name}", outputs=other_than_default(directory.absolute().parents[1]))


def attach_command(directory: Path, verb: str = "attach") -> str:
    """The ``sextant sweep`` command for the sweep in a directory, by default ``attach``."""
    return command("sweep", verb, directory.name, outputs=other_than_default(directory.absolute().parents[1]))


def find_sweep(reference: str, outputs: Path, reporter: Reporter = SILENT) -> Path:
    """Find the directory of a sweep given its name (the newest of that name), directory, or MLflow parent run.

    Args:
        reference: name, directory or parent run of the sweep.
        outputs: output folder.
        reporter: receives messages about damaged plans that are skipped, as any of them may have that name.

    Raises:
        UserError: the sweep does not exist, or it has not run here; an unknown sweep lists those that have run.
    """
    path = Path(reference).expanduser()
    if (path / "cells.json").is_file():
        return path.absolute()
    if (outputs / "sweeps" / reference / "cells.json").is_file():
        return outputs / "sweeps" / reference
    plans = sorted(read_plans(outputs, reporter).items(), key=lambda found: found[1].started, reverse=True)
    for directory, plan in plans:
        if reference == plan.name or reference in plan.mlflow_runs:
            return directory
    for file in outputs.glob("sweeps/*/cells.json"):
        if file.parent.name.rpartition("-")[0] == reference:  # damaged, which is reported when it is read
            return file.parent
    if (conf_dir() / "sweep" / f"{reference}.yaml").is_file():
        raise UserError(
            f"sweep={reference} has not run here: {outputs} has no files of it",
            f"Run it: {command('train', '-m', f'sweep={reference}')}. If it ran into another folder: outputs=<folder>.",
        )
    names = ", ".join(dict.fromkeys(plan.name for _, plan in plans))
    known = f"Sweeps here: {names}" if names else "There are no sweeps here yet: make sweep-demo makes one"
    raise UserError(f"sweep={reference}: no sweep of that name, directory or parent run. {known}")
