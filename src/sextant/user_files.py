"""Text and tables that users supply, and paths that do not exist."""

import csv
import difflib
import math
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from sextant.errors import UserError

#: marks at the beginning of a file -> its encoding; the longer ones first
MARKS = (
    (b"\xff\xfe\0\0", "utf-32"), (b"\0\0\xfe\xff", "utf-32"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"),
    (b"\xef\xbb\xbf", "utf-8-sig"),
)  # fmt: skip
#: beginnings of comments
COMMENTS = ("#", "%", "//")
#: largest number of names to compare with, as more would take long
MOST_NAMES = 5000
SEPARATORS = (";", ",", "\t", "|")
DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")


def absent(path: Path | str) -> str:
    """``<path> does not exist``, with the most similar name that does; or which link leads to nothing.

    Example:
        >>> absent("/usr/bim/env")
        '/usr/bim/env does not exist: there is no bim in /usr; did you mean /usr/bin?'
    """
    missing, near = _first_missing(Path(path)), nearest_path(path)
    if os.path.lexists(missing):
        kind = "is a folder" if missing.is_dir() else "is a file"
        is_what = kind if missing.exists() else f"is a broken link to {os.readlink(missing)}"
        return f"{path} {is_what}" if missing == Path(path) else f"{path} does not exist: {missing} {is_what}"
    where = "" if missing == Path(path) else f": there is no {missing.name} in {missing.parent}"
    return f"{path} does not exist{where}" + (f"; did you mean {near}?" if near else "")


def nearest_path(path: Path | str) -> Path | None:
    """The sibling whose name is most similar to the first missing part of a path; None if none is similar."""
    missing = _first_missing(Path(path))
    try:
        there = {name.casefold(): name for name in os.listdir(missing.parent)}
    except OSError:
        return None
    near = difflib.get_close_matches(missing.name.casefold(), there, n=1) if len(there) <= MOST_NAMES else []
    return missing.parent / there[near[0]] if near else None


def _first_missing(path: Path) -> Path:
    while not path.parent.is_dir() and path.parent != path.parent.parent:
        path = path.parent
    return path


def read_text(path: Path | str, fix: str | None = None) -> str:
    """The text of a file in UTF-8, or in UTF-16 or UTF-32 with a byte order mark.

    Raises:
        UserError: it does not exist (the message has the nearest name), cannot be read, or is not such text.
    """
    try:
        content = Path(path).read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        raise UserError(absent(path), fix) from None
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror}", fix) from None
    encoding = next((name for mark, name in MARKS if content.startswith(mark)), "utf-8")
    try:
        text = content.decode(encoding).lstrip("\ufeff")
        zero = text.find("\0")
    except UnicodeDecodeError as error:
        zero = error.start
    if zero >= 0:
        raise UserError(f"{path} cannot be read: byte {zero:,} is not text in UTF-8", fix or "Save it in UTF-8.")
    return text


def read_lines(path: Path | str, fix: str | None = None) -> list[tuple[int, list[str]]]:
    """The words of each line with its number, without comments, empty lines and separators at the end of lines.

    Raises:
        UserError: as :func:`read_text`.
    """
    lines = ((number, line.strip(" \t,;")) for number, line in _numbered(read_text(path, fix)))
    return [(number, line.split()) for number, line in lines if line and not line.startswith(COMMENTS)]


@dataclass(eq=False)
class TextTable:
    """A table as text.

    Attributes:
        path: its file.
        header: the cells of its first row, stripped and in lower case.
        rows: the number of the line on which each further row ends, and its stripped cells.
        separator: between cells. Where it is no comma, a comma may be the decimal mark.
    """

    path: Path
    header: tuple[str, ...]
    rows: list[tuple[int, list[str]]]
    separator: str = ","
    _marks: set[str] = field(default_factory=set, repr=False)

    def number(self, cell: str) -> float | None:
        """A cell as a finite number, or None.

        Raises:
            UserError: decimal commas and decimal points are mixed.
        """
        comma = self.separator != "," and DECIMAL_COMMA.fullmatch(cell) is not None
        try:
            value = float(cell.replace(",", ".") if comma else cell)
        except ValueError:
            return None
        self._marks.update("," if comma else "." if "." in cell else "")
        if len(self._marks) > 1:
            raise UserError(
                f"{self.path} has decimal commas and decimal points, such as {cell}", "Write all numbers alike: 12.5"
            )
        return value if math.isfinite(value) else None

    def long_rows(self) -> Iterator[str]:
        """A problem for each row that has more cells than the header, as decimal commas between commas make."""
        for line, cells in self.rows:
            if any(cells[len(self.header) :]):
                commas = self.separator == "," and any(map(str.isdecimal, cells))
                hint = ": decimal commas? Separate cells by ; then" if commas else ""
                yield f"line {line}: {len(cells)} values for {len(self.header)} columns{hint}"


def read_table(path: Path, fix: str | None = None) -> TextTable:
    """Read a table whose cells are separated by commas, semicolons, tabs or vertical bars, as its first line shows.

    Empty lines and comments are left out. A comment directly above a first row that begins with a number is the header
    if both have as many cells.

    Raises:
        UserError: as :func:`read_text`; or a cell is not closed.
    """
    return table_of(read_text(path, fix), path)


def check_columns(what: str, header: Sequence[str], used: Iterable[str]) -> None:
    """Raise a ``UserError`` if a column that is used is there more than once.

    Args:
        what: the table, for the message.
        header: its columns.
        used: those that are read if they are there.
    """
    for name in used:
        if (count := header.count(name)) > 1:
            raise UserError(f"{what} has {count} columns named {name}", "Remove or rename all but one of them.")


def table_header(path: Path, size: int = 65536) -> tuple[str, ...]:
    """The columns named by the first bytes of a table; none if it cannot be read."""
    try:
        with path.open("rb") as file:
            head = file.read(size)
        encoding = next((name for mark, name in MARKS if head.startswith(mark)), "utf-8")
        return table_of("\n".join(head.decode(encoding, "replace").splitlines()[:20]), path).header
    except (OSError, UserError):
        return ()


def table_of(text: str, path: Path) -> TextTable:
    """Parse a text as a table; ``path`` is for messages."""
    lines = [(number, line) for number, line in _numbered(text) if line.strip()]
    kept = [(number, line) for number, line in lines if not line.lstrip().startswith(COMMENTS)]
    if not kept:
        return TextTable(path, (), [])
    above = [line.lstrip().lstrip("".join(COMMENTS)) for number, line in lines if number < kept[0][0]]
    separator = _separator([line for _, line in kept])
    numbers, texts = zip(*kept, strict=True)
    rows = _cells(path, numbers, texts, separator)
    named = _cells(path, (0,), above[-1:], separator)
    if named and len(rows[0][1]) == len(named[0][1]) > 1 and _float(rows[0][1][0].replace(",", ".")):
        rows = [*named, *rows]
    header = tuple(cell.lower() for cell in rows[0][1])
    while header and not header[-1]:  # separators at the end of the line
        header = header[:-1]
    return TextTable(path, header, rows[1:], separator)


def _separator(lines: Sequence[str]) -> str:
    for separator in SEPARATORS:
        counts = {len(next(csv.reader([line], delimiter=separator), [])) for line in (lines[0], *lines[1:100])}
        if separator in lines[0] and (separator != ";" or "," not in lines[0] or len(counts) == 1):
            return separator
    return ","


def _cells(path: Path, numbers: Sequence[int], lines: Sequence[str], separator: str) -> list[tuple[int, list[str]]]:
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=separator != "\t")
    try:
        return [(numbers[reader.line_num - 1], [cell.strip() for cell in row]) for row in reader]
    except csv.Error as error:
        raise UserError(
            f"{path}: line {numbers[reader.line_num - 1]} cannot be read: {error}", "Is a quotation mark open above?"
        ) from None


def _numbered(text: str) -> Iterator[tuple[int, str]]:
    return enumerate(re.split(r"\r\n|\r|\n", text), start=1)


def _float(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
