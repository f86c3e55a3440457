"""Writes that are on disk when they return, and the errors reported when the disk refuses them."""

import errno
import hashlib
import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from numpy import ndarray

from sextant.errors import UserError

#: Error numbers of writes on a full disk, over a quota, or above the process's file size limit.
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class DiskFullError(UserError):
    """There is no disk space for what is to be rendered."""

    @classmethod
    def at(cls, folder: Path, needed: int) -> "DiskFullError":
        """The error for a folder that needs ``needed`` more bytes."""
        return cls(
            f"the disk is full: {folder} needs {readable(needed)} more, {readable(free_bytes(folder))} is free",
            "What was rendered is kept. Free some space and repeat the command: it resumes. "
            "Another disk: paths.cache=/path",
        )


def write_at(path: Path, offset: int, values: ndarray) -> str:
    """Overwrite part of a file, flushed to disk, and return the SHA-256 of what was written.

    It never uses a memory map, where a full disk kills the process (SIGBUS) instead of raising.

    Raises:
        OSError: the disk refused; the part may be half written.
    """
    content = values.reshape(-1).view("u1").data
    with path.open("r+b") as file:
        file.seek(offset)
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    return hashlib.sha256(content).hexdigest()


def free_bytes(folder: Path) -> int:
    """Bytes that can still be written below ``folder``, which need not exist yet."""
    for path in (folder, *folder.parents):
        with suppress(OSError):
            return shutil.disk_usage(path).free
    return 0


def allocated_bytes(paths: Iterable[Path]) -> int:
    """Bytes that files take on disk: less than their sizes if they are sparse."""
    total = 0
    for path in paths:
        with suppress(OSError):
            status = path.stat()
            total += getattr(status, "st_blocks", -(-status.st_size // 512)) * 512
    return total


@contextmanager
def reporting_disk_errors(folder: Path, needed: Callable[[], int]) -> Iterator[None]:
    """Turn disk errors raised inside the context into one message.

    Raises:
        DiskFullError: the disk is full; ``needed`` returns how many more bytes are to be written.
        UserError: ``folder`` cannot be written to.
    """
    try:
        yield
    except OSError as error:
        if error.errno in FULL:
            raise DiskFullError.at(folder, needed()) from None
        raise UserError(
            f"{folder} cannot be written to: {error.strerror or error}",
            "Choose another folder for rendered data: paths.cache=/path",
        ) from None


def readable(size: int) -> str:
    """A number of bytes in human-readable form: ``3.2 GB``."""
    value = float(size)
    for unit in ("bytes", "kB", "MB", "GB"):
        if value < 1000:
            return f"{value:,.0f} {unit}" if unit == "bytes" else f"{value:.1f} {unit}"
        value /= 1000
    return f"{value:,.1f} TB"
