"""The journal of a store: which chunks are on disk, and their hashes."""

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from stat import S_ISDIR
from threading import Lock

import numpy as np
from numpy import ndarray

from sextant.atomic_files import write_atomically
from sextant.errors import UserError


@dataclass(frozen=True)
class ChunkRecord:
    """One rendered chunk: the items from ``start`` up to ``stop`` (exclusive), and the SHA-256 of each array's part."""

    chunk: int
    start: int
    stop: int
    sha256: Mapping[str, str]


@dataclass(frozen=True)
class Grid:
    """How a store's items are divided into chunks."""

    count: int
    chunk: int

    @property
    def chunks(self) -> int:
        """Number of chunks; the last one may be shorter."""
        return -(-self.count // self.chunk)

    def span(self, chunk: int) -> tuple[int, int]:
        """First item of a chunk, and the first one after it."""
        return chunk * self.chunk, min(self.count, (chunk + 1) * self.chunk)


class Journal:
    """An append-only file with one line per chunk, written once the chunk is on disk.

    A process killed while appending leaves a torn last line, which is ignored and cut before the next append. Only the
    process that holds the store's lock writes.
    """

    def __init__(self, path: Path, grid: Grid):
        self.path = path
        self.grid = grid
        self._lock = Lock()
        self._forget()

    def records(self) -> dict[int, ChunkRecord]:
        """The rendered chunks; lines that cannot be parsed are skipped."""
        with self._lock:
            self._catch_up()
            return dict(self._records)

    def on_disk(self) -> ndarray:
        """For each chunk, whether it is rendered."""
        with self._lock:
            self._catch_up()
            return self._on_disk

    def _forget(self) -> None:
        self._inode, self._read = 0, 0
        self._records: dict[int, ChunkRecord] = {}
        self._on_disk = np.zeros(self.grid.chunks, dtype=bool)

    def _catch_up(self) -> None:
        """Read the lines appended since the last call; all lines if the file was replaced."""
        try:
            status = self.path.stat()
        except OSError:
            self._forget()
            return
        if status.st_ino != self._inode or status.st_size < self._read:
            self._forget()
            self._inode = status.st_ino
        if S_ISDIR(status.st_mode):
            raise UserError(f"{self.path} is a folder, where a file lists what is rendered", "Move it elsewhere.")
        if status.st_size == self._read:
            return
        with self.path.open("rb") as file:
            file.seek(self._read)
            new = file.read()
        whole = new.rfind(b"\n") + 1
        self._read += whole
        for line in new[:whole].splitlines():
            if (record := _parse(line, self.grid)) is not None:
                self._records[record.chunk] = record
                self._on_disk[record.chunk] = True

    def append(self, record: ChunkRecord) -> None:
        """Record a chunk; the record is on disk when this returns.

        Raises:
            OSError: the disk refused; the journal is unchanged.
        """
        with self.path.open("ab") as file:
            before = file.tell()
            try:
                file.write(_line(record))
                file.flush()
                os.fsync(file.fileno())
            except BaseException:
                with suppress(OSError):
                    os.truncate(self.path, before)
                raise

    def cut_torn_line(self) -> None:
        """Cut off what follows the last complete line.

        Raises:
            OSError: the disk refused.
        """
        if not self.path.exists():
            return
        content = self.path.read_bytes()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            os.truncate(self.path, whole)

    def keep(self, records: Mapping[int, ChunkRecord]) -> None:
        """Rewrite the journal atomically with only these chunks.

        Raises:
            OSError: the disk refused; the journal is unchanged.
        """
        content = b"".join(_line(records[chunk]) for chunk in sorted(records))
        write_atomically(self.path, lambda file: file.write(content))


def _line(record: ChunkRecord) -> bytes:
    return json.dumps(asdict(record), separators=(",", ":")).encode() + b"\n"


def _parse(line: bytes, grid: Grid) -> ChunkRecord | None:
    try:
        content = json.loads(line)
        record = ChunkRecord(int(content["chunk"]), content["start"], content["stop"], dict(content["sha256"]))
    except (ValueError, TypeError, KeyError):
        return None
    fits = 0 <= record.chunk < grid.chunks and grid.span(record.chunk) == (record.start, record.stop)
    return record if fits else None
