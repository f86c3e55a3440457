"""Files that a prediction could not use, as a table with the reasons."""

from collections.abc import Mapping

from rich.table import Table

from sextant.cli.console import rows_table
from sextant.data.places.problem_list import NAMED
from sextant.data.unusable_files import reason_alone


def skipped_table(skipped: Mapping[str, str], title: str = "Skipped") -> Table:
    """Files with the reasons why they were left out: the first of them, and how many more there are.

    Args:
        skipped: reasons by file.
        title: of the table.
    """
    rows = [{"file": name, "reason": reason_alone(name, problem)} for name, problem in list(skipped.items())[:NAMED]]
    more = len(skipped) - NAMED
    if more > 0:
        rows.append({"file": f"and {more:,} more", "reason": ""})
    table = rows_table(f"{title} ({len(skipped):,})", rows)
    for column, overflow in zip(table.columns, ("fold", "fold"), strict=True):  # a name that is cut names nothing
        column.justify, column.overflow = "left", overflow  # type: ignore[assignment]
    return table
