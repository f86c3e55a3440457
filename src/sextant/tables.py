"""Tables as Markdown, CSV and LaTeX."""

import csv
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

#: largest numbers of columns of values that are easy to read, and that are legible at all
USUAL, WIDEST = 8, 12
NOTHING = "–"


def counted(count: int, noun: str, plural: str | None = None) -> str:
    """A number with its noun.

    >>> counted(1, "run"), counted(2000, "run"), counted(2, "query", "queries")
    ('1 run', '2,000 runs', '2 queries')
    """
    return f"{count:,} {noun if count == 1 else plural or f'{noun}s'}"


@dataclass(frozen=True)
class TextTable:
    """Rows of text under a heading."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]

    def markdown(self) -> str:
        """A pipe table."""
        lines = [self.columns, ["---"] * len(self.columns), *self.rows]
        return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines) + "\n"

    def told(self) -> "TextTable":
        """The table without columns that are empty in every row: a dash, or the ``-`` of a sweep without settings."""
        kept = [i for i in range(len(self.columns)) if any(row[i] not in (NOTHING, "-", "") for row in self.rows)]
        return TextTable([self.columns[i] for i in kept], [[row[i] for i in kept] for row in self.rows])

    def only(self, columns: Sequence[str]) -> "TextTable":
        """The table of these columns alone."""
        kept = [self.columns.index(name) for name in columns]
        return TextTable(columns, [[row[i] for i in kept] for row in self.rows])

    def csv(self) -> str:
        """Comma-separated values."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows(self.rows)
        return text.getvalue()

    def latex(self) -> str:
        """A booktabs tabular, to be set in a table environment."""
        body = [" & ".join(map(_latex, row)) + r" \\" for row in self.rows]
        head = " & ".join(map(_latex, self.columns)) + r" \\"
        start = rf"\begin{{tabular}}{{{'l' * len(self.columns)}}}"
        return "\n".join([start, r"\toprule", head, r"\midrule", *body, r"\bottomrule", r"\end{tabular}"]) + "\n"


@dataclass(frozen=True)
class Entry:
    """The values of one arm for several quantities, as text.

    Attributes:
        heads: values that distinguish it from other entries of the arm, such as the setting.
        arm: name of the arm.
        values: values by quantity.
    """

    heads: Sequence[str]
    arm: str
    values: Mapping[str, str]


def arms_table(heads: Sequence[str], quantity: str, entries: Sequence[Entry]) -> TextTable:
    """A table with one row per entry and one column per quantity, or with one row per quantity and one column per arm.

    Arms become the columns if they are fewer than the quantities and there are more than ``USUAL`` quantities. If even
    the fewer of the two are more than ``WIDEST``, every value has its own row. A quantity without any value has no row.

    Args:
        heads: names of the columns that distinguish entries of an arm.
        quantity: heading of the column that names the quantities.
        entries: entries in the order of the table.
    """
    quantities = list(dict.fromkeys(name for entry in entries for name in entry.values))
    arms = list(dict.fromkeys(entry.arm for entry in entries))
    if len(quantities) <= min(WIDEST, max(USUAL, len(arms))):
        rows = [[*e.heads, e.arm, *(e.values.get(name, NOTHING) for name in quantities)] for e in entries]
        return TextTable([*heads, "arm", *quantities], rows)
    found = {(tuple(entry.heads), entry.arm): entry.values for entry in entries}
    told = {(key, name) for (key, _), values in found.items() for name, text in values.items() if text != NOTHING}
    keys = dict.fromkeys(key for key, _ in found)
    each = [(key, name) for key in keys for name in quantities if (key, name) in told]
    if len(arms) <= WIDEST:
        rows = [[*key, name, *(found.get((key, arm), {}).get(name, NOTHING) for arm in arms)] for key, name in each]
        return TextTable([*heads, quantity, *arms], rows)
    rows = [
        [*key, name, arm, found[key, arm][name]]
        for key, name in each
        for arm in arms
        if name in found.get((key, arm), {})
    ]
    return TextTable([*heads, quantity, "arm", "value"], rows)


def number(value: float, digits: int = 2, sign: bool = False) -> str:
    """A number with a fixed number of decimals; a dash for nan."""
    if value != value:
        return "–"
    return f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"


def interval(low: float, high: float, digits: int = 2, sign: bool = False) -> str:
    """``[low, high]``; a dash for nan."""
    if low != low or high != high:
        return "–"
    return f"[{number(low, digits, sign)}, {number(high, digits, sign)}]"


class Estimate(Protocol):
    """A mean with the bounds of its interval."""

    @property
    def mean(self) -> float: ...  # noqa: D102
    @property
    def low(self) -> float: ...  # noqa: D102
    @property
    def high(self) -> float: ...  # noqa: D102


def with_interval(found: Estimate | None, digits: int = 2, sign: bool = False, alone: bool = False) -> str:
    """``mean [low, high]``; a dash for None.

    Args:
        found: a mean and its interval.
        digits: number of decimals.
        sign: whether positive numbers have a sign.
        alone: whether a mean without an interval stands alone, not beside a dash.
    """
    if found is None:
        return NOTHING
    told = number(found.mean, digits, sign)
    return told if alone and found.low != found.low else f"{told} {interval(found.low, found.high, digits, sign)}"


def p_text(value: float) -> str:
    """A p-value; one that would be rounded to zero is shown as a bound."""
    return "<0.0001" if value < 0.00005 else number(value, 4)


def decimals(value: float, digits: int = 3) -> int:
    """The number of decimals that shows at least ``digits`` significant digits of a number."""
    if value == 0 or not math.isfinite(value):
        return digits - 1
    return max(0, digits - 1 - math.floor(math.log10(abs(value))))


def is_number(text: str) -> bool:
    """Whether a text is a finite number."""
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def slug(name: str) -> str:
    """A name as part of a file name."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", name.replace(" ", ""))


def _latex(text: str) -> str:
    for plain, escaped in (("\\", r"\textbackslash{}"), ("_", r"\_"), ("%", r"\%"), ("&", r"\&"), ("#", r"\#")):
        text = text.replace(plain, escaped)
    return text.replace("–", "--").replace("±", r"$\pm$")
