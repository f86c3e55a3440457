"""A bird's-eye map: blocks, houses, trees, and routes through them."""

from collections.abc import Iterable, Mapping

from jaxtyping import Float
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from numpy import ndarray

from sextant.figures.style import COLOURS, new_figure


def street_map(
    lots: Iterable[Float[ndarray, "k 2"]],
    houses: Float[ndarray, "n 4 2"],
    trees: Float[ndarray, "t 2"],
    routes: Mapping[str, Float[ndarray, "p 2"]],
    bounds: tuple[float, float, float, float],
) -> Figure:
    """Outlines seen from above, in metres east and north, with each route as a line that starts at a dot.

    Args:
        lots: outlines of the areas between streets.
        houses: corners of footprints.
        trees: their positions.
        routes: positions by name.
        bounds: left, bottom, right, top of the map.

    Example:
        >>> import numpy as np
        >>> block = np.array([[0.0, 0], [50, 0], [50, 40], [0, 40]])
        >>> houses, trees, walk = block[None] / 5 + 5, np.array([[30.0, 20]]), np.array([[0.0, -3], [50, -3]])
        >>> axes = street_map([block], houses, trees, {"walk": walk}, (-10, -10, 60, 50)).axes[0]
        >>> axes.get_xlabel(), axes.get_legend().get_texts()[0].get_text()
        ('metres east', 'walk')
    """
    left, bottom, right, top = bounds
    figure, (axes,) = new_figure(8, 8 * (top - bottom) / (right - left))
    axes.set_facecolor("#d9d7d2")
    axes.add_collection(PolyCollection(list(lots), facecolor="#e9ecdf", edgecolor="#c4c2bb", linewidth=0.4))
    axes.add_collection(PolyCollection(list(houses), facecolor="#b59f8d", edgecolor="#8d7968", linewidth=0.3))
    axes.scatter(trees[:, 0], trees[:, 1], s=2.5, color="#7fa36b", linewidths=0)
    for colour, (name, positions) in zip(COLOURS, routes.items(), strict=False):
        axes.add_collection(LineCollection([positions], color=colour, linewidth=1.8, label=name))
        axes.plot(*positions[0], "o", color=colour, markersize=6)
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", xlabel="metres east", ylabel="metres north")
    if routes:
        axes.legend(loc="upper right", fontsize=8)
    return figure
