"""The error message when writing to the folder ``output`` fails."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sextant.errors import UserError


@contextmanager
def telling_write_errors(folder: Path) -> Iterator[None]:
    """Turn write errors in the block into one message. Do not read files inside the block.

    Raises:
        UserError: the disk is full, or ``folder`` cannot be written to.
    """
    from sextant.data.rendered.disk import FULL, free_bytes, readable

    try:
        yield
    except OSError as error:
        if error.errno in FULL:
            raise UserError(
                f"output={folder}: the disk is full ({readable(free_bytes(folder))} free), so the output is incomplete",
                "Free some space and repeat the command, or write to another disk: output=/path",
            ) from None
        raise UserError(
            f"output={folder} cannot be written to: {error.strerror or error}", "Choose another folder: output=/path"
        ) from None
