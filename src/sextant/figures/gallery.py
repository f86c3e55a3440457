"""Images in a grid, each with a line of text."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Integer
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


def contact_sheet(
    images: Mapping[str, Float[ndarray, "n c h w"]],
    predictions: Mapping[str, Integer[ndarray, "n"]],
    labels: Integer[ndarray, "n"],
    classes: Sequence[str],
) -> Figure:
    """One row per condition, one column per image; the predicted class is in the corner, red if wrong.

    Args:
        images: by condition key, nominally in [0, 1]; values outside are clipped for display only.
        predictions: by condition key.
        labels: true classes.
        classes: names in label order.

    Example:
        >>> images = np.zeros((2, 3, 8, 8))
        >>> said = {"clean": np.array([0, 1]), "fog/3": np.array([0, 0])}
        >>> figure = contact_sheet({"clean": images, "fog/3": images}, said, np.array([0, 1]), ["cat", "dog"])
        >>> [text.get_text() for text in figure.axes[0].texts]  # the last is wrong
        ['cat', 'dog', 'cat', 'cat']
    """
    count, height, width = len(labels), *next(iter(images.values())).shape[2:]
    mosaic = np.concatenate([np.concatenate(list(batch), axis=2) for batch in images.values()], axis=1)
    picture = np.clip(mosaic, 0, 1).transpose(1, 2, 0)
    figure, (axes,) = new_figure(0.75 * count + 1.6, 0.75 * len(images) * height / width + 0.2)
    axes.imshow(picture[..., 0] if picture.shape[-1] == 1 else picture, cmap="gray", vmin=0, vmax=1)
    for row, key in enumerate(images):
        for column in range(count):
            chosen = int(predictions[key][column])
            colour = "#5CD65C" if chosen == int(labels[column]) else "#FF4D4D"
            corner = ((column + 0.04) * width, (row + 0.04) * height)
            axes.text(*corner, classes[chosen], color=colour, fontsize=7, va="top", fontweight="bold")
    axes.set_yticks([(row + 0.5) * height for row in range(len(images))], [key.replace("_", " ") for key in images])
    axes.tick_params(length=0, labelsize=8)
    axes.set_xticks([])
    return figure
