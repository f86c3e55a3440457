"""Similarities of all queries and references, with pairs that show the same place."""

import numpy as np
from jaxtyping import Float, Integer
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy import ndarray

from sextant.evaluation.places.positives import Positives
from sextant.figures.style import COLOURS, new_figure

#: Most cells of the picture in each direction; longer traverses are reduced to the largest similarity in each cell.
MOST_CELLS = 800
RIGHT, WRONG, TRUTH = COLOURS[2], COLOURS[1], COLOURS[5]  # distinct on grey
#: The grey scale spans the similarities between these percentiles.
CONTRAST = (1, 99.5)


def similarity_matrix(
    similarities: Float[ndarray, "m n"],
    positives: Positives | None = None,
    matches: Integer[ndarray, "m"] | None = None,
    *,
    query: str = "query",
    reference: str = "reference",
    title: str = "",
) -> Figure:
    """Queries by row, references by column, bright where similar.

    Args:
        similarities: of all pairs.
        positives: if given, the band from the first to the last positive of every query is outlined.
        matches: if given, the reference chosen for each query, coloured as right or wrong; needs ``positives``.
        query, reference: names of the traverses.
        title: such as the descriptor.

    Raises:
        ValueError: the shapes differ, or matches are given without positives.

    Example:
        >>> positives = Positives.from_lists([[0], [1], [2]], 3)
        >>> figure = similarity_matrix(np.eye(3), positives, np.array([0, 1, 0]), query="winter", reference="summer")
        >>> [text.get_text() for text in figure.legends[0].get_texts()]
        ['same place', 'wrong: 1 of 3', 'right: 2 of 3']
    """
    rows, columns = similarities.shape
    if positives is not None and (len(positives), positives.references) != similarities.shape:
        raise ValueError(f"need positives of {rows} queries among {columns} references")
    if matches is not None and (positives is None or len(matches) != rows):
        raise ValueError(f"need a match for each of the {rows} queries, and the positives to tell right from wrong")
    figure, (axes,) = new_figure(5.6, 4.9)
    reduced = _largest_in_cells(similarities)
    low, high = np.percentile(reduced[np.isfinite(reduced)], CONTRAST)
    picture = axes.imshow(
        reduced,
        cmap="gray",
        vmin=low,
        vmax=high,
        extent=(-0.5, columns - 0.5, rows - 0.5, -0.5),
        aspect="auto",
        interpolation="nearest",
    )
    handles = []
    if positives is not None:
        _outline(axes, positives)
    if positives is not None and positives.matchable.any():
        handles.append(Line2D([], [], color=TRUTH, lw=1, label="same place"))
    if matches is not None and positives is not None:
        right = positives.hits(matches[:, None])[:, 0]
        for chosen, colour, told in ((~right, WRONG, "wrong"), (right, RIGHT, "right")):
            axes.plot(matches[chosen], np.flatnonzero(chosen), ".", color=colour, markersize=3.5, mew=0)
            label = f"{told}: {chosen.sum()} of {rows}"
            handles.append(Line2D([], [], color=colour, marker=".", ls="", label=label))
    axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5), xlabel=f"{reference} frame", ylabel=f"{query} frame")
    axes.set_title(title, fontsize=9)
    figure.colorbar(picture, ax=axes, label="similarity", shrink=0.8)
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize=8)
    return figure


def _outline(axes: Axes, positives: Positives) -> None:
    """Draw the first and the last positive of every query, and nothing if it has none."""
    first, last = np.full(len(positives), np.nan), np.full(len(positives), np.nan)
    chosen = positives.matchable
    first[chosen] = positives.indices[positives.starts[:-1][chosen]] - 0.5
    last[chosen] = positives.indices[positives.starts[1:][chosen] - 1] + 0.5
    for edge in (first, last):
        axes.plot(edge, np.arange(len(positives)), color=TRUTH, lw=0.6, alpha=0.7)


def _largest_in_cells(values: Float[ndarray, "m n"]) -> Float[ndarray, "a b"]:
    """Reduce both directions to at most ``MOST_CELLS`` so that no bright pixel is lost."""
    for axis in (0, 1):
        starts = np.unique(np.linspace(0, values.shape[axis], min(MOST_CELLS, values.shape[axis]) + 1).astype(int)[:-1])
        values = np.maximum.reduceat(values, starts, axis=axis)
    return values
