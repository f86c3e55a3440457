"""Figures of place recognition."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Integer
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy import ndarray

from sextant.chapters.places.metrics import ConditionRecall, FactorRecall, PrecisionRecall
from sextant.evaluation.positives import Positives
from sextant.figures.style import COLOURS, new_figure, plain, printable

#: Largest number of cells per axis; longer traverses are reduced to the largest similarity in each cell.
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
        raise ValueError(f"need a match for each of the {rows} queries, and the positives to judge them by")
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
    """Draw the first and the last positive of every query that has one."""
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


UNKNOWN = "0.6"


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


def condition_confusion(result: ConditionRecall, title: str = "recall@1 (%)") -> Figure:
    """Query conditions by row and reference conditions by column; empty cells have no images.

    The title gives the mean over pairs of different conditions.

    >>> counts = np.full((2, 2), 10)
    >>> recall = ConditionRecall(("day", "night"), np.array([[1.0, 0.4], [0.3, 1.0]]), counts, 0 * counts)
    >>> condition_confusion(recall).axes[0].get_title().splitlines()
    ['recall@1 (%)', 'mean between two conditions 35.0']
    """
    size = len(result.conditions)
    figure, (axes,) = new_figure(0.7 * size + 2.3, 0.55 * size + 1.8)
    axes.imshow(np.ma.masked_invalid(result.recall), cmap="viridis", vmin=0, vmax=1, aspect="auto")
    axes.set_facecolor("0.9")
    for (row, column), value in np.ndenumerate(result.recall):
        if not np.isnan(value):
            colour = "black" if value > 0.6 else "white"
            axes.text(column, row, f"{100 * value:.0f}", ha="center", va="center", color=colour, fontsize=8)
    names = [name.replace("_", " ") for name in result.conditions]
    axes.set_xticks(range(size), names, rotation=35, ha="right", fontsize=8)
    axes.set_yticks(range(size), names, fontsize=8)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set(xlabel="references", ylabel="queries")
    across = "" if np.isnan(result.across) else f"\nmean between two conditions {100 * result.across:.1f}"
    axes.set_title(title + across, fontsize=9)
    return figure


COLUMNS = 4


def invariance_curves(
    factors: Mapping[str, Mapping[str, FactorRecall]],
    reference: Mapping[str, float] | None = None,
    metric: str = "recall@1",
    *,
    title: str = "",
) -> Figure:
    """One panel per factor, one curve per method with its 95 % interval as a band.

    Args:
        factors: by the factor's name (with its unit), then by method.
        reference: value of a factor in the reference images, marked by a vertical line.
        metric: name of the vertical axis.
        title: above all panels, such as the protocol.

    Raises:
        ValueError: there is no factor.

    Example:
        >>> import numpy as np
        >>> from sextant.chapters.places.metrics import factor_recall
        >>> fog = factor_recall(np.array([True, True, True, False]), np.array([0.0, 0.0, 0.5, 0.5]))
        >>> figure = invariance_curves({"fog": {"pixels": fog}}, reference={"fog": 0.0})
        >>> figure.axes[0].lines[0].get_xydata().tolist()
        [[0.0, 100.0], [0.5, 50.0]]
    """
    if not factors:
        raise ValueError("the figure needs at least one factor")
    methods = list(dict.fromkeys(method for curves in factors.values() for method in curves))
    columns = min(COLUMNS, len(factors))
    rows = -(-len(factors) // columns)
    figure, panels = new_figure(3.0 * columns, 2.7 * rows + 0.4, rows=rows, columns=columns)
    for axes in panels[len(factors) :]:
        axes.axis("off")
    for number, (axes, (factor, curves)) in enumerate(zip(panels, factors.items(), strict=False)):
        for method, curve in curves.items():
            colour = COLOURS[methods.index(method) % len(COLOURS)]
            axes.plot(curve.values, 100 * curve.recall, "o-", color=colour, markersize=3.5, lw=1.3)
            axes.fill_between(curve.values, 100 * curve.low, 100 * curve.high, color=colour, alpha=0.15, lw=0)
        if reference and factor in reference:
            axes.axvline(reference[factor], color="0.4", ls=":", lw=1)
        axes.set(ylim=(0, 101), xlabel=factor.replace("_", " "))
        if number % columns == 0:
            axes.set_ylabel(f"{metric} (%)")
        plain(axes)
    handles = [
        panels[0].plot([], [], "o-", color=COLOURS[number % len(COLOURS)], markersize=3.5, label=method)[0]
        for number, method in enumerate(methods)
    ]
    if reference and not reference.keys().isdisjoint(factors):
        handles += panels[0].plot([], [], ":", color="0.4", label="in the reference images")
    if title:
        figure.suptitle(title, fontsize=10)
    columns_of_legend = max(1, min(len(handles), 2 * columns))
    figure.legend(handles=handles, loc="outside lower center", ncols=columns_of_legend, frameon=False, fontsize=8)
    return figure


#: line styles that distinguish methods of the same colour
DASHES = ("-", "--", ":")


def precision_recall_curves(curves: Mapping[str, PrecisionRecall], title: str = "") -> Figure:
    """One curve per method, the best area first in the legend; a dot marks the largest recall at precision 1.

    Args:
        curves: by the method's name.
        title: such as the protocol.

    Raises:
        ValueError: there is no curve.

    Example:
        >>> from sextant.chapters.places.metrics import precision_recall
        >>> curve = precision_recall(np.array([0.9, 0.8, 0.7]), np.array([True, True, False]), positives=2)
        >>> precision_recall_curves({"HOG": curve}).axes[0].get_legend().get_texts()[0].get_text()
        'HOG  1.000'
    """
    if not curves:
        raise ValueError("the figure needs at least one curve")
    figure, (axes,) = new_figure(5.4, 4.2)
    ranked = sorted(curves.items(), key=lambda item: -np.nan_to_num(item[1].auc, nan=-1.0))
    for number, (name, curve) in enumerate(ranked):
        colour, dash = COLOURS[number % len(COLOURS)], DASHES[number // len(COLOURS) % len(DASHES)]
        label = f"{name}  {curve.auc:.3f}"
        axes.plot(100 * curve.recall, 100 * curve.precision, dash, color=colour, lw=1.4, label=label)
        sure = curve.recall_at_precision(1)
        if sure > 0:
            axes.plot(100 * sure, 100, "o", color=colour, markersize=4, clip_on=False, zorder=3)
    axes.set(xlim=(0, 100), ylim=(0, 102), xlabel="recall (% of queries with a positive)", ylabel="precision (%)")
    axes.set_title(title, fontsize=9)
    plain(axes)
    axes.legend(title="area under the curve", frameon=False, fontsize=8, title_fontsize=8)
    return figure
