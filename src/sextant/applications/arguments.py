"""Argument checks shared by several applications; imports nothing heavy."""

import errno
import os
from collections.abc import Iterable, Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from sextant.errors import ArgumentError, UserError, shown


def check_whole(argument: str, value: Any, least: int, fix: str, most: int | None = None) -> None:
    """Raise an ``ArgumentError`` if a value is not a whole number, below ``least`` or above ``most``."""
    limit = 2**63 - 1 if most is None else most
    if isinstance(value, bool) or not isinstance(value, Integral) or not least <= int(value) <= limit:
        up_to = "" if most is None else f" and at most {most}"
        raise ArgumentError(f"{argument}={shown(value)} must be a whole number, at least {least}{up_to}", fix)


def check_kind(argument: str, value: Any, kind: type, fix: str) -> None:
    """Raise an ``ArgumentError`` if a value is given, but is not a ``kind``."""
    if value is not None and not isinstance(value, kind):
        raise ArgumentError(f"{argument}={shown(value)} must be of the class {kind.__name__}", fix)


def make_folder(argument: str, folder: Path | str) -> Path:
    """Create the folder that an argument names, if necessary, with ``~`` expanded.

    Raises:
        UserError: it is a file, or cannot be created.
    """
    path = Path(folder).expanduser()
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        long = error.errno == errno.ENAMETOOLONG
        raise UserError(
            f"{argument}={path} is not a folder that can be written to: {error.strerror}",
            "A name has at most 255 bytes, a path 4,095."
            if long
            else f"For example {argument}={path.stem or 'found'}_2",
        ) from None
    return path


def check_share(argument: str, value: Any, fix: str) -> None:
    """Raise an ``ArgumentError`` if a value is given that is not a share above 0 and at most 1."""
    if value is not None and (isinstance(value, bool) or not isinstance(value, Real) or not 0 < float(value) <= 1):
        raise ArgumentError(f"{argument}={shown(value)} must be a share above 0 and at most 1", fix)


def check_apart(output: Path, photos: Sequence[Path] = (), /, *, key: str = "output", **inputs: Path | str) -> None:
    """Check that results are not written to an input folder: they would replace files, or be read by the next run.

    Folders are compared by their identity in the file system, so links, ``..`` and, on case-insensitive file systems,
    case make no difference. The folder around an input is allowed, and so is a folder within ``input``, where written
    pictures are recognized by their names; one within a map or queries is not, since other commands read these.

    Args:
        output: folder of the results, which need not exist.
        photos: files that are read.
        key: key of the output, for messages.
        inputs: folders that the user named, by key; anything but a folder is ignored.

    Raises:
        ArgumentError: the output is a file, a folder of the photos or one of the inputs, or lies in a map.

    Example:
        >>> check_apart(Path("found"), map="rides/day", queries="rides/night")
    """
    there = next((each for each in (output, *output.parents) if os.path.lexists(each)), output.parent)
    if not there.is_dir():
        how = "is not a folder that can be written to: it" if there == output else f"cannot be written to: {there}"
        raise ArgumentError(f"{key}={output} {how} is a file", f"Name a folder: {key}=found")
    whole = output.absolute().resolve()
    beside = f"Name a folder of its own: {key}={whole.parent / f'{whole.name}_found'}"
    around = {_identity(each) for each in whole.parents}
    if _identity(whole) in {_identity(each) for each in {photo.parent for photo in photos}}:
        raise ArgumentError(f"{key}={output} is a folder of the photos: results would replace files there", beside)
    for name, given in inputs.items():
        path = Path(given).expanduser()
        if not path.is_dir():
            continue
        if (own := _identity(path)) == _identity(whole):
            raise ArgumentError(f"{key}={output} is {name}={given}: results would be mixed with it", beside)
        if name != "input" and own in around:
            where = path.resolve().parent / f"{path.resolve().name}_found"
            raise ArgumentError(
                f"{key}={output} lies in {name}={given}: results would be read as part of it by the next run",
                f"Name a folder of its own: {key}={where}",
            )


def check_own_file(key: str, output: Path, read: Sequence[Path | str], endings: Sequence[str]) -> None:
    """Check that an output file is not one of the inputs, and that its name has one of the ``endings``.

    Raises:
        ArgumentError: it is a folder, an input by any of its names, or has another ending.

    Example:
        >>> check_own_file("json", Path("errors.json"), ["reference.txt", "estimate.txt"], [".json"])
    """
    same = _identity(output) in {_identity(Path(each).expanduser()) for each in read}
    if same or output.suffix not in endings or output.is_dir():
        raise ArgumentError(
            f"{key}={output} must be a file of its own that ends in {', '.join(endings)}",
            f"For example {key}=found{endings[0]}",
        )


def _identity(path: Path) -> tuple[int, int] | str:
    """A key shared by all names of a file or folder; the resolved path if it does not exist."""
    try:
        found = path.stat()
    except OSError:
        return str(path.absolute().resolve())
    return found.st_dev, found.st_ino


def check_several(argument: str, given: Any) -> None:
    """Raise an ``ArgumentError`` if a single path or other object was given instead of several."""
    if isinstance(given, Path | str):
        raise ArgumentError(
            f"{argument}={given} is one path; several {argument} are expected",
            f'For example Path("{given}").glob("*.jpg")',
        )
    if not isinstance(given, Iterable):
        raise ArgumentError(
            f"{argument} is of type {type(given).__name__}; several {argument} are expected",
            f"Give a list of them: {argument}=[first, second, ...]",
        )
