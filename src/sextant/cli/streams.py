"""Standard output and error of a process that may have been started without them, or whose disk is full.

A lost line must not end hours of work. What cannot be written is dropped, and the end of the command says so in one
line and its exit status. Only a reader that has gone (``| head``) ends the command.
"""

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

#: exit status of a command whose output was lost; 141 is that of a program ended by SIGPIPE
LOST, READER_GONE = 1, 141


class _Stream(io.FileIO):
    """A descriptor that drops what it cannot write, and keeps the first reason."""

    lost: OSError | None = None

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except BrokenPipeError:
            raise
        except OSError as error:
            self.lost = self.lost or error
            return len(data)


@contextmanager
def whole_streams() -> Iterator[None]:
    """Ensure writable standard streams while the block runs; report lost output at its end.

    Raises:
        SystemExit: with status 1 if output was lost, with 141 if the reader of a pipe has gone.
    """
    for number in range(3):  # a closed descriptor would be given to the next file that is opened
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = _opened(sys.stdout, sys.__stdout__, 1), _opened(sys.stderr, sys.__stderr__, 2)
    streams, gone, ended = (sys.stdout, sys.stderr), False, None
    try:
        yield
    except BrokenPipeError:
        gone = True
    except SystemExit as end:
        if end.code:
            raise
        ended = end
    finally:
        gone |= any([_flush(stream) for stream in streams])
        raws = [getattr(getattr(stream, "buffer", None), "raw", None) for stream in streams]
        lost = next((raw.lost for raw in raws if isinstance(raw, _Stream) and raw.lost), None)
        sys.stdout, sys.stderr = (old or new for old, new in zip(before, streams, strict=True))
        if lost is not None:
            with suppress(OSError):
                os.write(2, f"Error: the output could not be written: {lost.strerror}\n".encode())
    if gone or lost is not None:
        sys.exit(READER_GONE if gone else LOST)
    if ended is not None:
        raise ended


def _opened(now: TextIO | None, own: TextIO | None, number: int) -> TextIO:
    """Our stream in place of the process's own; a caller's replacement, as in tests, is kept."""
    if now is not None and (now is not own or not isinstance(now, io.TextIOWrapper)):
        if isinstance(now, io.TextIOWrapper):  # file names may contain bytes that are not UTF-8
            now.reconfigure(errors="backslashreplace")
        return now
    raw = _Stream(number, "wb", closefd=False)
    encoding = "utf-8" if now is None else now.encoding
    return io.TextIOWrapper(
        io.BufferedWriter(raw), encoding, "backslashreplace", line_buffering=raw.isatty() or number == 2
    )


def _flush(stream: TextIO) -> bool:
    """Whether the reader of a stream has gone; the rest is then discarded, as Python would report an error at exit."""
    try:
        stream.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        return True
    return False
