"""The output of commands, and the reporting of user errors."""

import errno
import logging
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from sextant.errors import UserError

WIDTH_WITHOUT_TERMINAL = 120


class _Console(Console):
    """Leaves the handling of a closed pipe to the command; Rich would exit with a failure."""

    def on_broken_pipe(self) -> None:
        raise  # noqa: PLE0704 - the error that is being handled


console = _Console(highlight=False, emoji=False, width=None if sys.stdout.isatty() else WIDTH_WITHOUT_TERMINAL)
errors = _Console(stderr=True, highlight=False, emoji=False, soft_wrap=True)


class _Shown(logging.Handler):
    """Prints log messages of the library to standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        errors.print(escape(record.getMessage()))


# here, since every worker process that shows output imports this module
logging.getLogger("sextant").addHandler(_Shown(logging.INFO))
logging.getLogger("sextant").setLevel(logging.INFO)


#: commands that resume when repeated after an interruption; and those that always end with Ctrl-C
RESUMED, SERVED = ("train", "data", "sweep", "corruptions"), ("dashboard", "demo")
#: what ``pathlib`` says of ``~`` for a user that this machine does not know
NO_HOME = "Could not determine home directory."
#: progress of unfinished work, such as ``{"rendering": "512/2,048 images"}``, and of what ended after it
_reached: dict[str, str] = {}
_ended: dict[str, str] = {}


def note_reached(work: str, where: str | None) -> None:
    """Note the progress of some work, for :func:`reporting_mistakes`; None if it has ended."""
    before = _reached.pop(work, None)
    if where is not None:
        _ended.clear()
        _reached[work] = where
    elif before is not None:
        _ended[work] = before


@contextmanager
def reporting_mistakes(verb: str = "") -> Iterator[None]:
    """Print a user error as one message and exit with status 2; Ctrl-C reports the progress and exits with status 130.

    Args:
        verb: the command, which determines the advice on repeating it.
    """
    try:
        yield
    except UserError as error:
        print_mistake(error)
        sys.exit(2)
    except KeyboardInterrupt:
        if verb not in SERVED:
            where = ", ".join(f"{work} {where}" for work, where in (_reached | _ended).items())
            resumes = "The same command resumes." if verb in RESUMED else "The same command starts again."
            errors.print(escape(f"Interrupted{where and f': {where}'}. {resumes}"))
        sys.exit(130)
    except BrokenPipeError:
        sys.exit(141)
    except RuntimeError as error:
        if str(error) != NO_HOME:
            raise
        print_mistake(UserError("a path starts with ~ and a name, but there is no such user here", "Write it in full."))
        sys.exit(2)
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        long = os.fsdecode(str(error.filename))
        print_mistake(UserError(f"{long[:40]}..: a name has at most 255 bytes, a path 4,095", "Give a shorter name."))
        sys.exit(2)
    finally:
        _reached.clear()
        _ended.clear()


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


def rows_table(title: str, rows: Sequence[Mapping[str, str]], most: int | None = None) -> Table:
    """A table of rows with the same columns, of which the first holds names.

    If it is wider than ``most`` characters, it has no lines between columns, and the words of headings lie one below
    the other, so that names alone have to be broken.
    """
    table = Table(title=escape(title), title_justify="left", title_style="bold")
    tight = most is not None and _width(rows) > most
    if tight:
        table.box, table.padding, table.show_edge = SIMPLE_HEAD, (0, 0, 0, 0), False
    for i, column in enumerate(rows[0]):
        heading = re.sub(r"(/| )(?=\S)", r"\1\n", column) if tight else column
        table.add_column(
            escape(heading), justify="left" if i == 0 else "right", no_wrap=tight and i > 0, overflow="fold"
        )
    for row in rows:
        table.add_row(*map(escape, row.values()))
    return table


def _width(rows: Sequence[Mapping[str, str]]) -> int:
    """The characters that rows take as a table with lines between the columns."""
    return sum(3 + max(len(column), *(len(row[column]) for row in rows)) for column in rows[0]) + 1
