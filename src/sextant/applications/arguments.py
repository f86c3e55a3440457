"""Argument checks shared by several applications; imports nothing heavy."""

import errno
from collections.abc import Iterable
from numbers import Integral
from pathlib import Path
from typing import Any

from sextant.errors import ArgumentError, UserError


def check_whole(argument: str, value: Any, least: int, fix: str, most: int | None = None) -> None:
    """Raise an ``ArgumentError`` if a value is not a whole number, below ``least`` or above ``most``."""
    limit = 2**63 - 1 if most is None else most
    if isinstance(value, bool) or not isinstance(value, Integral) or not least <= int(value) <= limit:
        up_to = "" if most is None else f" and at most {most}"
        raise ArgumentError(f"{argument}={value!r:.60} must be a whole number, at least {least}{up_to}", fix)


def check_kind(argument: str, value: Any, kind: type, fix: str) -> None:
    """Raise an ``ArgumentError`` if a value is given, but is not a ``kind``."""
    if value is not None and not isinstance(value, kind):
        raise ArgumentError(f"{argument}={value!r:.60} must be of the class {kind.__name__}", fix)


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


def check_several(argument: str, given: Any) -> None:
    """Raise an ``ArgumentError`` if one path, or another single thing, was given in place of several."""
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
