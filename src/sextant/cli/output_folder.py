"""The folder that a command's ``output=`` names: made, and what was written to it."""

from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape

from sextant.cli.console import console
from sextant.errors import UserError


def make_output(output: Path, key: str = "output") -> None:
    """Make the folder that a key names, if need be.

    Raises:
        UserError: it cannot be made.
    """
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"{key}={output} is not a folder that can be written to: {error.strerror}") from None


def tell_written(done: str, failed: int, written: Sequence[Path], why: str = "failed") -> None:
    """Print what was done, how many files were not used and why, and what was written."""
    console.print(done + (f", [red]{failed:,} {why}[/]" if failed else ""))
    console.print(escape("\n".join(map(str, written))))
