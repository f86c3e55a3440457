"""The output of commands, and the reporting of user errors."""

import logging
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from sextant.errors import UserError

WIDTH_WITHOUT_TERMINAL = 120

console = Console(highlight=False, emoji=False, width=None if sys.stdout.isatty() else WIDTH_WITHOUT_TERMINAL)
errors = Console(stderr=True, highlight=False, emoji=False, soft_wrap=True)


class _Shown(logging.Handler):
    """Prints log messages of the library to standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        errors.print(escape(record.getMessage()))


# here, since every worker process that shows output imports this module
logging.getLogger("sextant").addHandler(_Shown(logging.INFO))
logging.getLogger("sextant").setLevel(logging.INFO)


@contextmanager
def reporting_mistakes() -> Iterator[None]:
    """Print a user error as one message and exit with status 2; Ctrl-C exits with status 130."""
    try:
        yield
    except UserError as error:
        print_mistake(error)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:
        sys.exit(141)


def print_mistake(error: UserError) -> None:
    """Print one message: what is wrong in red, and below it what to do."""
    errors.print(f"[bold red]Error:[/] {escape(error.problem)}")
    if error.fix:
        errors.print(escape(error.fix))


def print_key_values(title: str, rows: Mapping[str, str]) -> None:
    """Print a title, which may be a long path, and below it two columns without lines."""
    console.print(Text(title, "bold"), soft_wrap=True)
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for key, value in rows.items():
        table.add_row(key, escape(value))
    console.print(table)


def rows_table(title: str, rows: Sequence[Mapping[str, str]]) -> Table:
    """A table of rows with the same columns, of which the first holds names."""
    table = Table(title=escape(title), title_justify="left", title_style="bold")
    for i, column in enumerate(rows[0]):
        table.add_column(column, justify="left" if i == 0 else "right")
    for row in rows:
        table.add_row(*map(escape, row.values()))
    return table
