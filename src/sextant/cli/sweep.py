"""Sweeps: factors x arms x seeds, of which only what is missing is run."""

import itertools
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from sextant.cli.assemble import build_source
from sextant.cli.compose import compose, to_plain
from sextant.cli.console import console
from sextant.cli.execute import run_key
from sextant.cli.train import check_environment
from sextant.config import Config, validate
from sextant.errors import UserError
from sextant.runs.directory import RunDirectory, claim
from sextant.runs.locks import run_lock
from sextant.runs.sweep_directory import Cell, SweepPlan, read_plan

Launch = Callable[[Sequence[Sequence[str]]], list[Any]]
POLL_S = 1.0


@dataclass(frozen=True)
class Planned:
    """A cell, the overrides that run it, and whether it is finished."""

    cell: Cell
    overrides: list[str]
    finished: bool


def run_sweep(arguments: Sequence[str], launch: Launch) -> None:
    """Plan a sweep, run its missing cells, and say how it went.

    Args:
        arguments: the overrides of the command line; those that list several values are its factors.
        launch: runs cells with Hydra's launcher and returns their outcomes.

    Raises:
        UserError: a cell's config is wrong; nothing was run then.
        SystemExit: status 1 if any cell failed; the others have run.
    """
    plan, planned, config = make_plan(arguments)
    outputs = Path(config.paths.outputs)
    with run_lock(outputs / "sweeps", plan.directory(outputs).name, wait=False):
        _run_planned(plan, planned, config, outputs, launch)


def _run_planned(plan: SweepPlan, planned: list[Planned], config: Config, outputs: Path, launch: Launch) -> None:
    if (plan.directory(outputs) / "cells.json").exists():  # begun before: it keeps its parent run
        plan = replace(plan, mlflow_runs=read_plan(plan.directory(outputs)).mlflow_runs)
    directory = plan.write(outputs)
    missing = [entry for entry in planned if not entry.finished]
    console.print(f"[bold]{plan.name}[/]: {len(planned)} runs planned, {len(planned) - len(missing)} finished already")
    if missing:
        plan = _run_missing(plan, missing, config, outputs, launch)
    _conclude(plan, outputs, directory)


def make_plan(arguments: Sequence[str]) -> tuple[SweepPlan, list[Planned], Config]:
    """Expand the command line and the ``sweep`` config into cells, each composed, validated and looked up on disk."""
    parsed = OverridesParser.create().parse_overrides(list(arguments))
    given = {o.key_or_group: _choices(o) for o in parsed}
    swept = {o.key_or_group: given[o.key_or_group] for o in parsed if o.is_sweep_override()}
    fixed = [o.input_line for o in parsed if not o.is_sweep_override() and o.input_line is not None]
    base = to_plain(compose([*fixed, *(f"{key}={choices[0]}" for key, choices in swept.items())]))
    definition: dict[str, Any] = base.get("sweep") or {"name": "sweep"}
    sweep = validate({**base, "sweep": definition}).sweep
    assert sweep is not None

    seeds = _seeds(swept.pop("seed", given.get("seed")), sweep.seeds if base.get("sweep") else [base["seed"]])
    factors = {key: given.get(key, [str(v) for v in values]) for key, values in sweep.factors.items()} | swept
    arms = {name: (arm.overrides, arm.seed_offset) for name, arm in sweep.arms.items()}
    _refuse_arm_keys(given, arms)
    if not arms and factors:  # without arms in the config, the last swept key is what is compared
        compared = list(factors)[-1]
        arms = {value: ([f"{compared}={value}"], 0) for value in factors.pop(compared)}
        definition |= {"arms": {name: {"overrides": overrides} for name, (overrides, _) in arms.items()}}
    if not arms:
        arms = {"run": ([], 0)}

    planned: list[Planned] = []
    checked: Config | None = None
    for values in itertools.product(*factors.values()):
        setting = dict(zip(factors, values, strict=True))
        for arm, (overrides, offset) in arms.items():
            common = [*fixed, *(f"{key}={value}" for key, value in setting.items()), *overrides]
            raw = to_plain(compose(common))
            config = validate(raw)
            if checked is None:
                check_environment(raw, config)
                checked = config
            source = build_source(raw, config)
            for pair, seed in enumerate(seeds):
                key = run_key(config, source, seed + offset)
                found = claim(Path(config.paths.outputs), key, config.reuse)
                run = found.directory.path.relative_to(Path(config.paths.outputs)).as_posix()
                cell = Cell(setting, arm, pair, key.seed, key.digest, run)
                planned.append(Planned(cell, [*common, f"seed={key.seed}"], found.finished))
    assert checked is not None
    tracking = {"kind": checked.tracking.kind, "uri": checked.tracking.uri}
    cells = [entry.cell for entry in planned]
    return SweepPlan(sweep.name, definition, list(arguments), cells, [], tracking, time.time()), planned, checked


def _seeds(given: list[str] | None, default: list[int]) -> list[int]:
    if given is None:
        return default
    if not all(seed.isdigit() for seed in given) or len(set(given)) < len(given):
        raise UserError(
            f"seed={','.join(given)}: seeds must be different whole numbers from 0", "For example seed=0,1,2"
        )
    return [int(seed) for seed in given]


def _refuse_arm_keys(given: Mapping[str, object], arms: Mapping[str, tuple[list[str], int]]) -> None:
    """A key that the arms of a stored sweep set cannot be set on the command line too."""
    for name, (overrides, _) in arms.items():
        for override in overrides:
            key = override.split("=")[0]
            if key in given:
                raise UserError(
                    f"{key} is what the arms of this sweep compare (arm {name} sets {override})",
                    f"Leave {key} out, or list the values in a sweep of your own: -m {key}=a,b",
                )


def _choices(override: Override) -> list[str]:
    """The values of an override, as text; one unless it sweeps."""
    if not override.is_sweep_override():
        return [override.get_value_element_as_str()] if override.value() is not None else ["null"]
    try:
        return [str(value) for value in override.sweep_string_iterator()]
    except (HydraException, ValueError):
        raise UserError(
            f"{override.input_line}: a sweep lists its values", f"For example {override.key_or_group}=a,b,c"
        ) from None


def _run_missing(plan: SweepPlan, missing: list[Planned], config: Config, outputs: Path, launch: Launch) -> SweepPlan:
    quiet = ["trainer.progress=false"]
    parent = None
    if config.tracking.kind != "none":
        from sextant.tracking.sweep_parent import open_parent

        experiment = config.tracking.experiment or config.task.name
        parent = open_parent(config.tracking.kind, config.tracking.uri, outputs, plan, experiment)
        if parent.run_id not in plan.mlflow_runs:
            plan = replace(plan, mlflow_runs=[*plan.mlflow_runs, parent.run_id])
        plan.write(outputs)
        quiet.append(f"tracking.parent_run={parent.run_id}")
    try:
        with _progress(missing, outputs):
            outcomes = launch([[*entry.overrides, *quiet] for entry in missing])
    except BaseException as error:
        if parent is not None:
            parent.status("KILLED" if isinstance(error, KeyboardInterrupt | SystemExit) else "FAILED")
        raise
    failed = {
        entry.cell.run: outcome["message"]
        for entry, outcome in zip(missing, outcomes, strict=True)
        if outcome["outcome"] == "failed"
    }
    plan = replace(plan, cells=[replace(c, message=failed.get(c.run, "")) for c in plan.cells])
    plan.write(outputs)
    if parent is not None:
        parent.status("FAILED" if failed else "FINISHED")
    return plan


@contextmanager
def _progress(missing: list[Planned], outputs: Path) -> Iterator[None]:
    """A bar over the missing cells, fed by looking at their directories: it works with every launcher."""
    columns = (TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    done = threading.Event()
    files = [RunDirectory(outputs / entry.cell.run).metrics for entry in missing]

    def watch() -> None:
        finished = 0
        with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
            task = bar.add_task("", total=len(files))
            while True:
                now = sum(file.is_file() for file in files)
                bar.update(task, completed=now)
                if now > finished and not console.is_terminal:
                    console.print(f"{now}/{len(files)} runs")
                finished = now
                if done.wait(POLL_S):
                    return

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        done.set()
        watcher.join()


def _conclude(plan: SweepPlan, outputs: Path, directory: Path) -> None:
    outcomes: Counter[str] = Counter()
    for cell in plan.cells:
        results = RunDirectory(outputs / cell.run).results()
        outcomes[results["outcome"] if results is not None else "failed"] += 1
    counts = ", ".join(f"{outcomes[name]} {name}" for name in ("finished", "diverged", "failed"))
    console.print(f"[bold]{plan.name}[/]: {len(plan.cells)} planned, {counts}")
    for cell in plan.cells:
        if cell.message:
            console.print(f"[red]failed[/] {cell.setting} {cell.arm} seed {cell.seed}: {escape(cell.message)}")
    console.print(f"report  python report.py sweep={directory.name}")
    if outcomes["failed"]:
        raise SystemExit(1)


def check_sweep_overrides(overrides: Sequence[str]) -> None:
    """Find a mistake in any single choice of a sweep before the sweep is planned: each is composed once.

    Raises:
        UserError: as :func:`sextant.cli.compose.compose`.
    """
    try:
        parsed = OverridesParser.create().parse_overrides(list(overrides))
    except Exception:
        compose(overrides)  # names the override that cannot be parsed
        raise UserError(f"cannot parse {' '.join(overrides)}") from None
    choices = [
        [f"{o.key_or_group}={choice}" for choice in _choices(o)] if o.is_sweep_override() else [o.input_line or ""]
        for o in parsed
    ]
    first = [options[0] for options in choices]
    compose(first)
    for number, options in enumerate(choices):
        for option in options[1:]:
            compose([*first[:number], option, *first[number + 1 :]])
