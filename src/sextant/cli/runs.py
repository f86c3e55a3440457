"""``sextant runs``: list runs, or delete them from both disk and store."""

import shutil
import time
from collections.abc import Mapping, Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table

from sextant.cli.terminal import TERMINAL
from sextant.console.console import console
from sextant.errors import UserError
from sextant.runs.directory import RunDirectory, all_runs
from sextant.runs.locks import run_lock
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.sweep_directory import read_plans
from sextant.tracking.environment import quiet_libraries

USAGE = "sextant runs [list | delete <task>/<run> ...]"


def main(arguments: Sequence[str]) -> None:
    """List all runs, or delete some."""
    verb, names = (arguments[0], list(arguments[1:])) if arguments else ("list", [])
    if verb in ("-h", "--help"):
        print(USAGE)
    elif verb == "list":
        _list()
    elif verb == "delete" and names:
        _delete(names)
    else:
        raise UserError(f"runs {' '.join(arguments)}: not understood", USAGE)


def _list() -> None:
    outputs = default_outputs()
    arms: dict[str, dict[str, None]] = {}
    for plan in read_plans(outputs, TERMINAL).values():
        for cell in plan.cells:
            arms.setdefault(cell.run, {})[f"{plan.name}: {cell.arm}"] = None
    table = Table()
    table.add_column("run", no_wrap=True)  # the only name by which a run is deleted
    for heading in ("outcome", "begun", "sweep: arm", "metric", "settings", "MLflow run"):
        table.add_column(heading, overflow="fold")
    for directory in all_runs(outputs):
        state, results = directory.state(), directory.results()
        outcome = str(results["outcome"]) if results else str(state.get("failure") or "unfinished")
        params = state.get("params", {})
        settings = ", ".join(str(params.get(f"{g}._target_", "")).rsplit(".", 1)[-1] for g in ("dataset", "backbone"))
        ids, arm = directory.tracking_ids(), ", ".join(arms.get(directory.path.relative_to(outputs).as_posix(), ()))
        began = time.strftime("%Y-%m-%d %H:%M", time.localtime(state["started"])) if "started" in state else ""
        cells = (
            _name(directory),
            outcome.splitlines()[0],
            began,
            arm,
            _metric(results),
            settings,
            ids[-1] if ids else "",
        )
        table.add_row(*map(escape, cells))
    console.print(table)


def _metric(results: Mapping[str, Any] | None) -> str:
    """The first metric of the test, or of validation."""
    metrics = (results or {}).get("metrics", {})
    name = next((name for name in metrics if name.startswith("test/")), next(iter(metrics), None))
    return "" if name is None or metrics[name] is None else f"{name} {metrics[name]:.4g}"


def _delete(names: list[str]) -> None:
    outputs = default_outputs()
    known = {_name(directory): directory for directory in all_runs(outputs)}
    for name in names:
        if name not in known:
            raise UserError(f"runs delete {name}: no such run", "sextant runs lists them")
    for name in names:
        directory = known[name]
        base = f"{directory.state().get('digest', '')[:8]}-s{directory.state().get('seed')}"
        with run_lock(directory.path.parent, base, wait=False):
            if (outputs / "mlflow.db").exists() and directory.tracking_ids():
                from sextant.tracking.store import delete_runs

                quiet_libraries()
                delete_runs(outputs, directory.tracking_ids())
            shutil.rmtree(directory.path)
        console.print(f"deleted {name}")


def _name(directory: RunDirectory) -> str:
    return f"{directory.path.parent.name}/{directory.path.name}"
