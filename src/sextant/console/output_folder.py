"""The output folder of a command: creating it, and reporting what was written to it."""

from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape

from sextant.applications.arguments import make_folder
from sextant.console.console import console


def make_output(output: Path, key: str = "output") -> None:
    """Create the folder that a key names, if necessary; a ``UserError`` if that is not possible."""
    make_folder(key, output)


def tell_written(done: str, failed: int, written: Sequence[Path], why: str = "failed") -> None:
    """Print what was done, how many files were not used and why, and what was written."""
    console.print(done + (f", [red]{failed:,} {why}[/]" if failed else ""))
    console.print(escape("\n".join(map(str, written))))
