"""The folder that a command's ``output=`` names: made, written to, and what is reported when the disk refuses it."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.markup import escape

from sextant.cli.console import console
from sextant.errors import UserError


def make_output(output: Path) -> None:
    """Make the folder, if need be.

    Raises:
        UserError: it cannot be made.
    """
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"output={output} is not a folder that can be written to: {error.strerror}") from None


def tell_written(done: str, failed: int, written: Sequence[Path], why: str = "failed") -> None:
    """Print what was done, how many files were not used and why, and what was written."""
    console.print(done + (f", [red]{failed:,} {why}[/]" if failed else ""))
    console.print(escape("\n".join(map(str, written))))


@contextmanager
def telling_write_errors(folder: Path) -> Iterator[None]:
    """Turn what the disk refuses inside into one message. Nothing that reads belongs inside.

    Raises:
        UserError: the disk is full, or ``folder`` cannot be written to.
    """
    from sextant.data.rendered.disk import FULL, free_bytes, readable

    try:
        yield
    except OSError as error:
        if error.errno in FULL:
            raise UserError(
                f"output={folder}: the disk is full ({readable(free_bytes(folder))} free), not everything was written",
                "Free some space and repeat the command, or write to another disk: output=/path",
            ) from None
        raise UserError(
            f"output={folder} cannot be written to: {error.strerror or error}", "Choose another folder: output=/path"
        ) from None
