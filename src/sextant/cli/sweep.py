"""``train.py -m``: a sweep, and how it went."""

from collections.abc import Sequence

from rich.markup import escape

from sextant.cli.console import console
from sextant.cli.terminal import TERMINAL
from sextant.lifecycle import sweep
from sextant.lifecycle.workers import Launch


def run_sweep(arguments: Sequence[str], launch: Launch) -> None:
    """Run a sweep, and say how it went.

    Args:
        arguments: the overrides of the command line; those that list several values are its factors.
        launch: runs cells with Hydra's launcher and returns their outcomes.

    Raises:
        UserError: a cell's config is wrong; nothing was run then.
        SystemExit: status 1 if any cell failed; the others have run.
    """
    found = sweep.run_sweep(arguments, launch, TERMINAL)
    counts = ", ".join(f"{found.count(name)} {name}" for name in ("finished", "diverged", "failed"))
    console.print(f"[bold]{found.name}[/]: {len(found.cells)} planned, {counts}")
    for cell in found.cells:
        if cell.message:
            console.print(f"[red]failed[/] {cell.setting} {cell.arm} seed {cell.seed}: {escape(cell.message)}")
    console.print(f"report  sextant report sweep={found.directory.name}")
    if found.count("failed"):
        raise SystemExit(1)
