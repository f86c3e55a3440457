"""A part of a report: text, tables as files, and pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Section:
    """What one part adds to a report.

    Attributes:
        text: Markdown, with its heading; empty if there is nothing to say.
        files: contents of further files, by name.
        figures: named pictures to write beside the text.
    """

    text: str = ""
    files: Mapping[str, str] = field(default_factory=dict)
    figures: "Sequence[tuple[str, Figure]]" = ()
