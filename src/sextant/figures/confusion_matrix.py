"""Confusion matrix of a classifier."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Integer
from matplotlib.figure import Figure
from numpy import ndarray

from sextant.figures.style import new_figure


def confusion_matrix(
    labels: Integer[ndarray, "n"], predictions: Integer[ndarray, "n"], classes: Sequence[str]
) -> Figure:
    """Counts by true class (rows) and predicted class (columns), coloured by the share of the row.

    >>> figure = confusion_matrix(np.array([0, 0, 1]), np.array([0, 1, 1]), ["cat", "dog"])
    >>> figure.axes[0].images[0].get_array().data  # one of two cats was classified as a dog
    array([[0.5, 0.5],
           [0. , 1. ]])
    """
    size = len(classes)
    counts = np.zeros((size, size), int)
    np.add.at(counts, (labels.astype(int), predictions.astype(int)), 1)
    share = counts / np.maximum(counts.sum(1, keepdims=True), 1)
    side = max(4.0, 0.45 * size)
    figure, (axes,) = new_figure(side + 0.8, side)
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1)
    if size <= 20:
        for row, column in np.ndindex(size, size):
            if counts[row, column]:
                colour = "white" if share[row, column] > 0.5 else "black"
                axes.text(column, row, str(counts[row, column]), ha="center", va="center", color=colour, fontsize=7)
    axes.set_xticks(range(size), classes, rotation=90 if max(map(len, classes)) > 2 else 0, fontsize=8)
    axes.set_yticks(range(size), classes, fontsize=8)
    axes.set(xlabel="predicted", ylabel="true")
    return figure
