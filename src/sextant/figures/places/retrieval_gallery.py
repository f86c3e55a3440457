"""Queries with the references retrieved for them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy import ndarray

from sextant.figures.style import COLOURS, new_figure, printable

RIGHT, WRONG, UNKNOWN = COLOURS[2], COLOURS[1], "0.6"


@dataclass(frozen=True)
class Retrieved:
    """One row of the gallery.

    Attributes:
        query: image ``(h, w)``, ``(h, w, 1)`` or ``(h, w, 3)`` of bytes.
        matches: images found, most similar first.
        right: whether each shows the query's place; None if unknown.
        title: above the query, such as its frame.
        titles: above the matches, such as frame and similarity; none by default.
        truth: an image of the right place, shown last, for queries that have one.
    """

    query: ndarray
    matches: Sequence[ndarray]
    right: Sequence[bool | None]
    title: str = ""
    titles: Sequence[str] = ()
    truth: ndarray | None = None


def retrieval_gallery(rows: Sequence[Retrieved], title: str = "") -> Figure:
    """The query on the left, then its matches, framed as right (green, ✓), wrong (red, ✗) or unknown (grey).

    If a row has a truth, a last column shows it.

    Raises:
        ValueError: there is no row, or the numbers of verdicts and matches of a row differ.

    Example:
        >>> image = np.zeros((8, 16, 3), np.uint8)
        >>> figure = retrieval_gallery([Retrieved(image, [image, image], [True, False], "frame 7", ["a", "b"])])
        >>> [axes.get_title() for axes in figure.axes]
        ['frame 7', '✓ a', '✗ b']
    """
    if not rows:
        raise ValueError("the gallery needs at least one query")
    if any(len(row.right) != len(row.matches) for row in rows):
        raise ValueError("need a verdict (or None) for each match")
    most = max(len(row.matches) for row in rows)
    columns = 1 + most + any(row.truth is not None for row in rows)
    height, width = rows[0].query.shape[:2]
    shape = height / width
    figure, cells = new_figure(1.5 * columns, (1.5 * shape + 0.3) * len(rows) + 0.5, rows=len(rows), columns=columns)
    for number, row in enumerate(rows):
        line = cells[number * columns : (number + 1) * columns]
        for cell in line:
            cell.set_axis_off()
        _show(line[0], row.query, row.title, None)
        titles = [*row.titles, *[""] * (most - len(row.titles))]
        for cell, image, verdict, told in zip(line[1:], row.matches, row.right, titles, strict=False):
            mark = {True: "✓ ", False: "✗ ", None: ""}[None if verdict is None else bool(verdict)]
            colour = {"✓ ": RIGHT, "✗ ": WRONG, "": UNKNOWN}[mark]
            _show(cell, image, mark + told, colour)
        if row.truth is not None:
            _show(line[-1], row.truth, "the place itself", None)
    figure.suptitle(printable(title), fontsize=9)
    return figure


def _show(cell: Axes, image: ndarray, title: str, colour: str | None) -> None:
    cell.set_axis_on()
    picture = np.squeeze(image, axis=2) if image.ndim == 3 and image.shape[2] == 1 else image
    cell.imshow(picture, cmap="gray", vmin=0, vmax=255, aspect="equal")
    cell.set(xticks=[], yticks=[])
    cell.set_title(printable(title), fontsize=7, pad=3, color=colour if colour in (RIGHT, WRONG) else "black")
    for spine in cell.spines.values():
        spine.set(visible=colour is not None, edgecolor=colour or "none", linewidth=2.5)
