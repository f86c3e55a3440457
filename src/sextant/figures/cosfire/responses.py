"""Detections of a COSFIRE filter in an image: the image, the response over it, and keypoints with scores."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.figure import Figure
from numpy import ndarray

from sextant.figures.style import COLOURS, new_figure, printable

#: most keypoints with their score beside them
MOST_SCORES = 25
#: opacity of the strongest response
OPAQUE = 0.85


def cosfire_responses(
    image: UInt8[ndarray, "h w *c"],
    response: Float[ndarray, "y x"],
    points: Sequence[tuple[float, float, float]] = (),
    *,
    strongest: float | None = None,
    title: str = "",
) -> Figure:
    """Image, response and keypoints side by side.

    Args:
        image: grey ``(h, w)`` or ``(h, w, 1)``, or RGB; bytes.
        response: over the image, of any size: its cells cover the image.
        points: x and y in pixels of the image, and the score of each.
        strongest: the response at the top of the colour scale; None for the largest one in ``response``.
        title: above the figure.

    Example:
        >>> response = np.zeros((16, 16))
        >>> response[4, 8] = 0.9
        >>> figure = cosfire_responses(np.zeros((32, 32), np.uint8), response, [(16.5, 8.5, 0.9)])
        >>> [axes.get_title() for axes in figure.axes[:3]], figure.axes[2].texts[0].get_text()
        (['image', 'response', '1 found'], '0.90')
    """
    picture = image[..., 0] if image.ndim == 3 and image.shape[2] == 1 else image
    height, width = picture.shape[:2]
    top = float(response.max()) if strongest is None else strongest
    figure, axes = new_figure(3 * 3.2 + 0.6, 3.2 * height / width + 0.6, columns=3)
    for cell in axes:
        cell.imshow(picture, cmap="gray", vmin=0, vmax=255)
    share = np.clip(response / top if top > 0 else np.zeros_like(response), 0, 1)
    drawn = axes[1].imshow(
        response,
        cmap="inferno",
        vmin=0,
        vmax=top if top > 0 else 1,
        alpha=OPAQUE * np.sqrt(share),  # so that weak responses are visible too
        extent=(-0.5, width - 0.5, height - 0.5, -0.5),
        interpolation="nearest",
    )
    figure.colorbar(drawn, ax=axes[1], shrink=0.7, pad=0.02).ax.tick_params(labelsize=7)
    for number, (x, y, score) in enumerate(points):
        axes[2].plot(x, y, "o", markersize=9, markerfacecolor="none", markeredgecolor="black", markeredgewidth=2.6)
        axes[2].plot(x, y, "o", markersize=9, markerfacecolor="none", markeredgecolor=COLOURS[4], markeredgewidth=1.5)
        if number < MOST_SCORES:
            axes[2].annotate(
                f"{score:.2f}",
                (x, y),
                xytext=(6, 4),
                textcoords="offset points",
                fontsize=7,
                color="white",
                bbox={"boxstyle": "round,pad=0.15", "facecolor": "black", "alpha": 0.6, "linewidth": 0},
            )
    names = ("image", "response", f"{len(points)} found")
    for cell, name in zip(axes, names, strict=True):
        cell.set(xticks=[], yticks=[], xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
        cell.set_title(name, fontsize=8)
    if title:
        figure.suptitle(printable(title), fontsize=9)
    return figure
