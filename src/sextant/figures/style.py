"""The common style of all figures."""

from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

#: Okabe & Ito's palette, distinct to colour-blind readers.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")


def new_figure(width: float, height: float, rows: int = 1, columns: int = 1) -> tuple[Figure, list[Axes]]:
    """A figure of ``width`` by ``height`` inches outside pyplot's global state, and its axes row by row.

    >>> figure, axes = new_figure(6.0, 4.0, rows=2, columns=3)
    >>> len(axes), figure.get_size_inches()
    (6, array([6., 4.]))
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    return figure, list(axes.ravel())


def plain(axes: Axes) -> Axes:
    """Remove the top and right sides of the frame and draw a light grid.

    >>> figure, (axes,) = new_figure(3.0, 2.0)
    >>> plain(axes).spines["top"].get_visible()
    False
    """
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25, linewidth=0.6)
    return axes


def titled(figure: Figure, title: str) -> Figure:
    """Put a title above the panels of a figure, unless it has one: above all of them, or above its only panel.

    >>> figure, (axes,) = new_figure(3.0, 2.0)
    >>> titled(figure, "confusion matrix").get_suptitle()
    'confusion matrix'
    """
    panels = [axes for axes in figure.axes if axes.get_label() != "<colorbar>"]
    only = panels[0] if len(panels) == 1 else None
    above = only is not None and (only.get_title() or only.get_title("left") or only.get_title("right"))
    if not (above or figure.get_suptitle()):
        figure.suptitle(title, fontsize=9)
    return figure


def printable(text: str) -> str:
    r"""Text with the non-UTF-8 bytes of file names escaped, which Matplotlib would refuse to draw.

    >>> printable("caf\udce9.jpg")
    'caf\\udce9.jpg'
    """
    return text.encode(errors="backslashreplace").decode()


def shortened(text: str, most: int) -> str:
    """The last ``most`` characters of each line, which distinguish files, printable and taken literally by Matplotlib.

    >>> shortened("rides/2026-11-28/morning/0001.jpg", 20)
    '…28/morning/0001.jpg'
    """
    lines = (line if len(line) <= most else f"…{line[1 - most :]}" for line in printable(text).split("\n"))
    return "\n".join(lines).replace("$", r"\$")  # text between two of them would be set as mathematics


def save_figure(figure: Figure, folder: Path, name: str, formats: tuple[str, ...] = ("png",)) -> list[Path]:
    """Write ``folder/name.<format>`` and return the paths; the same figure gives the same bytes.

    By default, Matplotlib gives the parts of an SVG random names and dates the file; both are suppressed here.

    >>> import tempfile
    >>> figure, _ = new_figure(1.0, 1.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in save_figure(figure, Path(folder), "empty", ("png", "svg"))]
    ['empty.png', 'empty.svg']
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{name}.{suffix}" for suffix in formats]
    for path in paths:
        metadata = {"Date": None} if path.suffix == ".svg" else None
        with matplotlib.rc_context({"svg.hashsalt": name}):
            figure.savefig(path, dpi=150, bbox_inches="tight", metadata=metadata)
    return paths
