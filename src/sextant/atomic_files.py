"""Files that are written completely or not at all."""

import csv
import hashlib
import io
import json
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

#: key in a JSON file of the hash of all its other keys
SEAL = "seal"


def write_atomically(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Let ``write`` fill a temporary file, then rename it to ``path``.

    Raises:
        OSError: the disk is full or not writable; an existing file at ``path`` is unchanged.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    name = path.name if len(os.fsencode(path.name)) < 230 else hashlib.sha256(os.fsencode(path.name)).hexdigest()
    temporary = path.with_name(f".{name}.{os.getpid()}.tmp")  # no longer than a file system allows
    try:
        with temporary.open("wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_json(path: Path, value: Any) -> None:
    """Write ``value`` as indented JSON, atomically; nan and infinities are written as null."""
    content = json_bytes(value)
    write_atomically(path, lambda file: file.write(content))


def json_bytes(value: Any) -> bytes:
    """``value`` as indented JSON; nan and infinities become null."""
    return (json.dumps(_finite(value), indent=2, allow_nan=False) + "\n").encode()


def write_sealed_json(path: Path, value: Mapping[str, Any]) -> None:
    """Like :func:`write_json`, with the hash of the content under ``seal``; :func:`seal_holds` checks it."""
    plain = {key: inner for key, inner in _finite(dict(value)).items() if key != SEAL}
    write_json(path, plain | {SEAL: _sha256(plain)})


def seal_holds(content: Mapping[str, Any]) -> bool:
    """Whether content that was read is what :func:`write_sealed_json` wrote; content without a seal is accepted."""
    return SEAL not in content or content[SEAL] == _sha256({k: v for k, v in content.items() if k != SEAL})


def write_csv(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Write a table with a header line, atomically; missing values are left empty, booleans become true or false.

    Bytes of a file name that are not UTF-8 are escaped.
    """
    table = io.StringIO()
    writer = csv.DictWriter(table, columns, extrasaction="ignore", restval="")
    writer.writeheader()
    for row in rows:
        writer.writerow({key: str(value).lower() if isinstance(value, bool) else value for key, value in row.items()})
    write_atomically(path, lambda file: file.write(table.getvalue().encode(errors="backslashreplace")))


def read_json(path: Path) -> Any | None:
    """The content of a JSON file, or None if it does not exist or is not JSON."""
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):
        return None


def _sha256(content: Mapping[str, Any]) -> str:
    """Hash plain values, independently of the layout of the file that holds them."""
    plain = json.loads(json.dumps(content))  # as they are read back from a file
    return hashlib.sha256(json.dumps(plain, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def hash_file(path: Path) -> str:
    """SHA-256 of a file, read in pieces.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def file_sha256(path: Path) -> str:
    """:func:`hash_file`, cached as long as the file's size and modification time stay the same."""
    status = path.stat()
    return _file_sha256(path, status.st_size, status.st_mtime_ns)


@lru_cache(maxsize=2**20)
def _file_sha256(path: Path, size: int, mtime_ns: int) -> str:
    return hash_file(path)
