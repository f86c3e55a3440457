"""Files that a prediction could not use: a table of them and why, or the mistake where there were no others."""

from collections.abc import Mapping

from rich.table import Table

from sextant.cli.console import rows_table
from sextant.data.places.problem_list import NAMED, problem_list
from sextant.errors import UserError


def skipped_table(skipped: Mapping[str, str], title: str = "Skipped") -> Table:
    """Files with the reasons why they were left out: the first of them, and how many more there are.

    Args:
        skipped: reasons by file.
        title: of the table.
    """
    rows = [{"file": name, "reason": _reason(name, problem)} for name, problem in list(skipped.items())[:NAMED]]
    more = len(skipped) - NAMED
    if more > 0:
        rows.append({"file": f"and {more:,} more", "reason": ""})
    table = rows_table(f"{title} ({len(skipped):,})", rows)
    for column, overflow in zip(table.columns, ("fold", "fold"), strict=True):  # a name that is cut names nothing
        column.justify, column.overflow = "left", overflow  # type: ignore[assignment]
    return table


def nothing_usable(problem: str, skipped: Mapping[str, str], fix: str | None = None) -> UserError:
    """The mistake of an input of which nothing could be used; names the files.

    Args:
        problem: what is wrong with all of them.
        skipped: reasons by file.
        fix: what to do.
    """
    listed = problem_list([f"{name}: {_reason(name, why)}" for name, why in skipped.items()])
    return UserError(f"{problem}\n{listed}", fix or "Replace these files, or name others.")


def _reason(name: str, problem: str) -> str:
    """A problem without the name of the file that it starts with, on one line."""
    return " ".join(problem.removeprefix(name).lstrip(": ").split())
