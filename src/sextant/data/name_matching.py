"""Match images with the rows of a table or reconstruction by name.

Programs write names relative to different folders, with backslashes, percent escapes, other Unicode forms or letter
cases, or leave suffixes out. Names are compared in steps, from the literal name to the last part of the path without
case and suffix, and a pair that one step joins takes no part in later ones: an exact match wins.
"""

import re
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from urllib.parse import unquote

from sextant.data.file_kinds import RAW
from sextant.data.photo_files import FOUND_IN_FOLDERS
from sextant.errors import UserError
from sextant.tables import counted

_SUFFIX = re.compile(rf"({'|'.join(map(re.escape, (*FOUND_IN_FOLDERS, *RAW)))})$", re.IGNORECASE)


@dataclass(frozen=True)
class NameMatches:
    """The rows of images.

    Attributes:
        rows: for each image, the index of its row, or None.
        ambiguous: images or rows that fit several, each as one line for a message.
    """

    rows: list[int | None]
    ambiguous: tuple[str, ...] = ()

    @property
    def remark(self) -> str:
        """What is ambiguous, with an example that has both sides; "" if nothing is."""
        count = len(self.ambiguous)
        many = "1 name is ambiguous:" if count == 1 else f"{count:,} names are ambiguous, such as"
        return f"{many} {self.ambiguous[0]}" if count else ""

    def refuse_ambiguous(self, where: str) -> "NameMatches":
        """The same matches.

        Raises:
            UserError: names are ambiguous; the message has both sides.
        """
        if self.ambiguous:
            raise UserError(
                f"{where}: {self.remark}",
                "Leave one row for each image. Where images have the same name, write their paths in full.",
            )
        return self


def match_names(images: Sequence[str], listed: Sequence[str], *, whole: bool = False) -> NameMatches:
    r"""Match images with the names that a table lists.

    Args:
        images: paths relative to some folder, written with ``/``.
        listed: names of the rows.
        whole: all parts of an image's path must agree; only the row's may have more in front of them.

    Example:
        >>> match_names(["left/1.jpg", "right/1.jpg"], [r"images\right\1.JPG", "./left/1"]).rows
        [1, 0]
        >>> match_names(["1.jpg"], ["left/1.jpg", "right/1.jpg"]).ambiguous
        ('1.jpg may be left/1.jpg or right/1.jpg',)
    """
    rows: list[int | None] = [None] * len(images)
    ambiguous: list[str] = []
    left, right = dict(enumerate(images)), dict(enumerate(listed))
    before: list[tuple[list[str], list[str]]] = []
    for of_image, of_row in STEPS:
        written = [of_image(images[i]) for i in left], [of_row(listed[row]) for row in right]
        if written in before:  # it would join nothing more
            continue
        before = [written, *before]
        own = {i: name.split("/") for i, name in zip(left, written[0], strict=True)}
        other = {row: name.split("/") for row, name in zip(right, written[1], strict=True)}
        for depth in (0, *range(max(map(len, own.values()), default=0), 0, -1)):
            ends, others = _by_end(own, depth, whole), _by_end(other, depth)
            for end in ends.keys() & others.keys():
                mine, theirs = ends[end], others[end]
                if len(mine) == len(theirs) == 1:
                    rows[mine[0]] = theirs[0]
                else:
                    ambiguous.append(_told([images[i] for i in mine], [listed[row] for row in theirs]))
                for image in mine:
                    del left[image], own[image]
                for row in theirs:
                    del right[row], other[row]
    return NameMatches(rows, tuple(ambiguous))


def _by_end(parts: Mapping[int, Sequence[str]], depth: int, whole: bool = False) -> dict[str, list[int]]:
    """Indices by the last ``depth`` parts of their names, which have at least as many; 0 stands for all parts."""
    found: dict[str, list[int]] = {}
    for i, each in parts.items():
        if not depth or len(each) == depth or (len(each) > depth and not whole):
            found.setdefault("/".join(each[-depth:] if depth else ["", *each]), []).append(i)
    return found


def _told(images: Sequence[str], rows: Sequence[str]) -> str:
    if len(images) == 1 < len(rows) and len(set(rows)) == 1:
        return f"{images[0]} has {counted(len(rows), 'row')}"
    return f"{' and '.join(images[:3])} may be {' or '.join(rows[:3])}"


def _clean(name: str) -> str:
    path = name if name.isascii() else unicodedata.normalize("NFC", name)
    path = path.strip().removeprefix("file://").replace("\\", "/")
    return "/".join(part for part in path.split("/") if part not in ("", "."))


def _unquoted(name: str) -> str:
    cleaned = _clean(name)
    return unicodedata.normalize("NFC", unquote(cleaned)) if "%" in cleaned else cleaned


def _stem(name: str) -> str:
    return _SUFFIX.sub("", _unquoted(name))


def _folded(written: Callable[[str], str]) -> Callable[[str], str]:
    return lambda name: written(name).casefold()


#: how the name of an image and that of a row are written in each step, the strictest first
STEPS: tuple[tuple[Callable[[str], str], Callable[[str], str]], ...] = (
    (str, str),
    (_clean, _clean),
    (_unquoted, _unquoted),
    (_stem, _unquoted),
    (_unquoted, _stem),
    (_folded(_unquoted), _folded(_unquoted)),
    (_folded(_stem), _folded(_unquoted)),
    (_folded(_unquoted), _folded(_stem)),
)
