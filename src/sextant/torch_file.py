"""Files of ``torch.save``: ours carry their own digest, and all others are checked as far as they allow.

A sealed file ends in a zip comment: ``sextant sha256`` and the hash of every byte before it. Content and digest are one
file, which is renamed into place at once, so a kill cannot separate them and a copy takes both. Any program that reads
files of ``torch.save`` can read it. A zip without the comment (older, or from another program) has the CRC of each
part, which torch itself does not check; a legacy pickle has nothing.
"""

import hashlib
import zipfile
import zlib
from collections.abc import Container, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import torch
from torch import Tensor

from sextant.errors import UserError

SEAL = b"sextant sha256 "
DIGITS = 64
BLOCK = 1 << 20
#: the record that ends a zip: its signature, and its length when the comment is empty; the last field is the comment's
#: length
END, END_BYTES = b"PK\x05\x06", 22
FIX = "Copy it again from its source; a checkpoint of a run without a copy can only be recreated by training."


@contextmanager
def building() -> Iterator[None]:
    """Within the block, networks for stored weights are made of float32, as they are in training.

    Torch's default type may be another; this and its random state are afterwards as before.
    """
    before = torch.get_default_dtype()
    with torch.random.fork_rng(devices=[]):
        torch.set_default_dtype(torch.float32)
        try:
            yield
        finally:
            torch.set_default_dtype(before)


def save_sealed(value: Any, file: BinaryIO) -> None:
    """Write what ``torch.save`` writes, followed by its digest.

    Args:
        value: tensors and plain containers.
        file: an empty file, open for writing.

    Raises:
        OSError, RuntimeError: the disk is full; torch wraps the former in the latter.
    """
    sealing = _Sealing(file)
    torch.save(value, sealing)  # type: ignore[arg-type]  # it needs only write and flush
    sealing.finish()


def load_verified(path: Path) -> Any:
    """Load a file of ``torch.save`` to the CPU after checking it for damage.

    Nothing in it is executed: torch refuses anything but tensors and plain containers.

    Raises:
        FileNotFoundError: there is no such file.
        UserError: the content does not match its digest, or a part does not match its CRC.
        Exception: any kind, from a file that torch cannot read.
    """
    with path.open("rb") as file:  # opened once, so that the verified content is read even if another file replaces it
        _verify(path, file)
        file.seek(0)
        return torch.load(file, map_location="cpu", weights_only=True)


def require_finite(tensors: Mapping[str, Any], path: Path, known: Container[str] | None = None) -> None:
    """Check that weights are finite.

    Args:
        tensors: tensors by name; anything but floating-point tensors is ignored.
        path: the file that they come from.
        known: names of those to check; None for all.

    Raises:
        UserError: a tensor contains nan or infinity.
    """
    looked_at = [name for name in tensors if known is None or name in known]
    bad = [name for name in looked_at if isinstance(tensors[name], Tensor) and not _is_finite(tensors[name])]
    if bad:
        raise UserError(
            f"{path} holds weights that are not finite: {len(bad)} of {len(looked_at)} arrays, the first is {bad[0]}",
            "Its training diverged, or its file was damaged before it was copied here. Use another checkpoint.",
        )


def _is_finite(tensor: Tensor) -> bool:
    return not (tensor.is_floating_point() or tensor.is_complex()) or bool(tensor.isfinite().all())


def _verify(path: Path, file: BinaryIO) -> None:
    size = file.seek(0, 2)
    file.seek(max(0, size - len(SEAL) - DIGITS))
    end = file.read()
    if end.startswith(SEAL):
        if _sha256(file, size - len(end)) != end.removeprefix(SEAL):
            raise UserError(f"{path} is damaged: its contents do not match the digest that was written with them", FIX)
        return
    file.seek(0)
    if file.read(4) != b"PK\x03\x04" and not zipfile.is_zipfile(file):
        return  # a legacy pickle, or not a file of torch.save at all; torch will report that
    if end[-END_BYTES:][:4] != END or end[-2:] != b"\0\0":  # so that a damaged seal is not taken for a missing one
        raise UserError(f"{path} is damaged: it does not end as a file of torch.save does", FIX)
    if (bad := _bad_part(file)) is not None:
        raise UserError(f"{path} is damaged: {bad}", FIX)


def _sha256(file: BinaryIO, length: int) -> bytes:
    """Hash the first bytes of a file, in hexadecimal."""
    digest = hashlib.sha256()
    file.seek(0)
    while length > 0 and (block := file.read(min(BLOCK, length))):
        digest.update(block)
        length -= len(block)
    return digest.hexdigest().encode()


def _bad_part(file: BinaryIO) -> str | None:
    """What is wrong with a zip; None if nothing is."""
    try:
        with zipfile.ZipFile(file) as archive:
            bad = archive.testzip()
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, RuntimeError, NotImplementedError) as error:
        return str(error).splitlines()[0] if str(error) else type(error).__name__
    return None if bad is None else f"{bad} does not match its CRC"


class _Sealing:
    """Hashes what is written, and holds back the record that ends the zip."""

    def __init__(self, file: BinaryIO):
        self._file, self._digest, self._held = file, hashlib.sha256(), b""

    def write(self, data: Any) -> int:
        """Write all but the last bytes."""
        view = memoryview(data).cast("B")
        if len(view) < END_BYTES:
            view = memoryview(self._held + bytes(view))
        else:
            self._emit(self._held)
        cut = max(0, len(view) - END_BYTES)
        self._emit(view[:cut])
        self._held = bytes(view[cut:])
        return len(data)

    def flush(self) -> None:
        """Do nothing: the end is not written yet."""

    def finish(self) -> None:
        """Announce the comment in the last record, and write both."""
        assert self._held[:4] == END
        assert self._held[-2:] == b"\0\0"
        self._emit(self._held[:-2] + (len(SEAL) + DIGITS).to_bytes(2, "little"))
        self._file.write(SEAL + self._digest.hexdigest().encode())

    def _emit(self, data: bytes | memoryview) -> None:
        self._digest.update(data)
        self._file.write(data)
