"""Images in a grid, each with a line of text."""

from collections.abc import Sequence

from matplotlib.figure import Figure
from numpy import ndarray

from sextant.figures.style import new_figure, shortened

COLUMNS = 8
#: letters of a title that fit above an image
LONGEST = 20


def gallery(images: Sequence[ndarray], titles: Sequence[str]) -> Figure:
    """Images ``(h, w)`` or ``(h, w, 3)`` of bytes, eight per row, with their titles above.

    >>> import numpy as np
    >>> figure = gallery([np.zeros((8, 8), np.uint8)] * 3, ["a", "b", "c"])
    >>> [axes.get_title() for axes in figure.axes]
    ['a', 'b', 'c']
    """
    columns = min(COLUMNS, len(images))
    rows = -(-len(images) // columns)
    figure, axes = new_figure(1.3 * columns, 1.5 * rows, rows=rows, columns=columns)
    for cell in axes:
        cell.axis("off")
    for cell, image, title in zip(axes, images, titles, strict=False):
        cell.imshow(image, cmap="gray", vmin=0, vmax=255)
        cell.set_title(shortened(title, LONGEST), fontsize=7, pad=2)
    return figure
