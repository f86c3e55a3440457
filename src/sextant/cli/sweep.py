"""``train.py -m`` runs a sweep and reports how it went; ``sextant sweep`` manages one that runs elsewhere."""

import shlex
from collections import Counter
from collections.abc import Sequence
from contextlib import chdir
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from sextant.cli.terminal import TERMINAL
from sextant.composing.config_files import own_configs, without_folder
from sextant.composing.overrides import quoted
from sextant.console.arguments import parse_arguments
from sextant.console.console import console
from sextant.errors import UserError
from sextant.lifecycle import sweep
from sextant.lifecycle.search.run import sweep_or_search
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.sweep_directory import find_sweep, read_plan, report_command
from sextant.tables import counted

#: override that names the output folder
OUTPUTS = "paths.outputs="
USAGE = "sextant sweep status|attach|cancel <sweep> [outputs=<folder>]"


def main(arguments: Sequence[str]) -> None:
    """Show, wait for or cancel a sweep that runs in another process or on a cluster."""
    if any(argument in ("-h", "--help") for argument in arguments):
        print(
            f"{USAGE}\n\n  status  show how many runs are finished, running, waiting or failed\n"
            "  attach  wait for the remaining runs, and resubmit those that were lost\n"
            "  cancel  stop running and waiting runs; finished runs are kept"
        )
        return
    verb, names = (arguments[0], [word for word in arguments[1:] if "=" not in word]) if arguments else ("", [])
    verbs = {"status": _status, "attach": _attach, "cancel": _cancel}
    if verb not in verbs or len(names) != 1:
        raise UserError(f"sweep {' '.join(arguments)}: not understood".replace("  ", " "), USAGE)
    given = parse_arguments([word for word in arguments[1:] if "=" in word], {"outputs": "output folder"}, USAGE)
    outputs = Path(given.get("outputs", default_outputs())).expanduser().absolute()
    verbs[verb](find_sweep(names[0], outputs, TERMINAL))


def run_sweep(arguments: Sequence[str], wait: bool | None = None, run_cells: sweep.Launch | None = None) -> None:
    """Run a sweep, and report how it went.

    Args:
        arguments: the overrides of the command line; those that list several values are its factors.
        wait, run_cells: as for :func:`sextant.lifecycle.sweep.run_sweep`.

    Raises:
        UserError: a cell's config is wrong; nothing has been run then.
        SystemExit: with status 1 if any cell failed; the others have run.
    """
    found = sweep_or_search(arguments, TERMINAL, runs=TERMINAL, wait=wait, run_cells=run_cells)
    states = ("finished", "diverged", "failed", *(["submitted"] if found.count("submitted") else []))
    counts = ", ".join(f"{found.count(state)} {state}" for state in states)  # type: ignore[arg-type]
    console.print(f"[bold]{found.name}[/]: {len(found.cells)} planned, {counts}")
    for cell in found.cells:
        if cell.message:
            console.print(f"[red]failed[/] {escape(f'{cell.setting} {cell.arm} seed {cell.seed}: {cell.message}')}")
    if found.count("diverged"):
        from sextant.lifecycle.results import sweep_results
        from sextant.reports.divergence import divergence

        console.print(divergence(sweep_results(found)).replace("**", ""), markup=False, soft_wrap=True)
    console.print(f"report  {report_command(found.directory)}", markup=False, soft_wrap=True)
    if found.count("failed"):
        raise SystemExit(1)


def show_dry_run(arguments: Sequence[str]) -> None:
    """Print the runs that are missing, and the script for sbatch."""
    cells, script = sweep.dry_run(arguments, TERMINAL)
    for cell in cells:
        print(f"{cell.name}  {shlex.join(cell.overrides)}")
    print(f"{counted(len(cells), 'run is', 'runs are')} missing")
    if script:
        print(f"\n{script}")


def _status(directory: Path) -> None:
    from sextant.lifecycle.sweep_status import sweep_status

    states, controller = sweep_status(directory, TERMINAL)
    counts = Counter(state.state for state in states)
    console.print(f"[bold]{directory.name}[/]: {', '.join(f'{n} {state}' for state, n in sorted(counts.items()))}")
    console.print(f"run by {controller}" if controller else "no process is waiting for it")
    shown = [state for state in states if state.where]
    if shown:
        table = Table("run", "state", "where, or why")
        for state in shown:
            table.add_row(state.run, state.state, escape(state.where))
        console.print(table)


def _attach(directory: Path) -> None:
    plan = read_plan(directory)
    overrides, folder = without_folder(plan.command)
    with chdir(plan.here if Path(plan.here).is_dir() else "."), own_configs(folder):
        run_sweep(_into(directory.parents[1], overrides), wait=True)


def _into(outputs: Path, words: list[str]) -> list[str]:
    """The words of a sweep with the output folder in which it lies, if they lead to another one."""
    given = [word.partition("=")[2].strip("'\"") for word in words if word.startswith(OUTPUTS)]
    if (Path(given[-1]).expanduser().absolute() if given else default_outputs()) == outputs:
        return words
    return [*(word for word in words if not word.startswith(OUTPUTS)), f"{OUTPUTS}{quoted(str(outputs))}"]


def _cancel(directory: Path) -> None:
    from sextant.lifecycle.sweep_status import cancel_sweep

    console.print(cancel_sweep(directory))
