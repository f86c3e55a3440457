"""Run benchmarks by name, or all of them, and print one table."""

import sys
from importlib import import_module

from rich.console import Console
from rich.table import Table

from benchmarks.machine import describe_machine

NAMES = (
    *("start_up", "training_loop", "skip_cell", "sweep_size", "launchers", "worlds", "crops", "photos"),
    *("push_pull", "precisions", "corruptions", "retrieval", "describe", "cosfire"),
    *("local_gp", "particle_filter", "localization"),
)


def main(names: list[str]) -> None:
    if wrong := [name for name in names if name not in NAMES]:
        raise SystemExit(f"python -m benchmarks {wrong[0]}: must be one of {', '.join(NAMES)}; all if none is named")
    table = Table("benchmark", "measured", "against", "ratio", "aim")
    for name in names or NAMES:
        for row in import_module(f"benchmarks.{name}").run():
            table.add_row(*row)
    console = Console(width=130)
    console.print(describe_machine())
    console.print(table)


if __name__ == "__main__":
    main(sys.argv[1:])
