"""The output folder of a command: creating it, and reporting what was written to it."""

from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape

from sextant.applications.arguments import make_folder
from sextant.cli.console import console
from sextant.errors import UserError


def make_output(output: Path, key: str = "output") -> None:
    """Create the folder that a key names, if necessary; a ``UserError`` if that is not possible."""
    make_folder(key, output)


def refuse_to_lose(key: str, path: Path | None, read: Sequence[str | Path]) -> None:
    """Raise a ``UserError`` if the file that a key names is one of the input files, or is not a JSON file."""
    if path is None:
        return
    if path.suffix != ".json" or any(path.resolve() == Path(each).resolve() for each in read):
        raise UserError(f"{key}={path} must be a file of its own that ends in .json", f"For example {key}=found.json")


def tell_written(done: str, failed: int, written: Sequence[Path], why: str = "failed") -> None:
    """Print what was done, how many files were not used and why, and what was written."""
    console.print(done + (f", [red]{failed:,} {why}[/]" if failed else ""))
    console.print(escape("\n".join(map(str, written))))
