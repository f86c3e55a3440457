"""The output folder of a command: creating it, and reporting what was written to it."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.markup import escape

from sextant.applications.arguments import make_folder
from sextant.console.console import console, rows_table
from sextant.data.photo_files import nothing_usable, reason_alone
from sextant.errors import NAMED


def skipped_of(rows: Iterable[Mapping[str, Any]], problem: str) -> dict[str, str]:
    """The reasons why files could not be used, by file.

    Args:
        rows: one row per file, with an ``error`` if it could not be used.
        problem: error message if no file could be used.

    Raises:
        UserError: no file could be used.
    """
    errors = {str(row["file"]): row.get("error") for row in rows}
    skipped = {name: str(error) for name, error in errors.items() if error is not None}
    if len(skipped) == len(errors):
        raise nothing_usable(problem, skipped)
    return skipped


def tell_skipped(skipped: Mapping[str, str], title: str = "Skipped") -> None:
    """Print a table of the first files that were skipped with the reasons, and how many more there are.

    Args:
        skipped: reasons by file; nothing is printed if it is empty.
        title: title of the table.
    """
    if not skipped:
        return
    rows = [{"file": name, "reason": reason_alone(name, problem)} for name, problem in list(skipped.items())[:NAMED]]
    more = len(skipped) - NAMED
    if more > 0:
        rows.append({"file": f"and {more:,} more", "reason": ""})
    table = rows_table(f"{title} ({len(skipped):,})", rows)
    for column, overflow in zip(table.columns, ("fold", "fold"), strict=True):  # a truncated name would be useless
        column.justify, column.overflow = "left", overflow  # type: ignore[assignment]
    console.print(table)


def make_output(output: Path, key: str = "output") -> None:
    """Create the folder that a key names, if necessary; a ``UserError`` if that is not possible."""
    make_folder(key, output)


def tell_written(done: str, failed: int, written: Sequence[Path], why: str = "failed") -> None:
    """Print what was done, how many files were not used and why, and what was written."""
    console.print(done + (f", [red]{failed:,} {why}[/]" if failed else ""))
    console.print(escape("\n".join(map(str, written))))
