"""Files that a prediction could not use, and a table of them."""

from collections.abc import Iterable, Mapping
from typing import Any

from sextant.console.console import console, rows_table
from sextant.data.unusable_files import nothing_usable, reason_alone
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
