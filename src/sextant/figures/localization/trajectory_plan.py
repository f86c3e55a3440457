"""A trajectory and its estimate, seen from above."""

import numpy as np
from jaxtyping import Float64
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy import ndarray

from sextant.figures.style import new_figure, plain


def trajectory_plan(reference: Float64[ndarray, "n 3"], estimate: Float64[ndarray, "n 3"]) -> Figure:
    """Draw the estimate, coloured by error, over the reference in grey, in the two axes of most extent; then the error.

    Args:
        reference, estimate: positions of the same frames in metres.

    Raises:
        ValueError: there is no frame, or shapes differ.

    Example:
        >>> straight = np.column_stack([np.arange(5.0), np.zeros(5), np.zeros(5)])
        >>> figure = trajectory_plan(straight, straight + [0, 0.5, 0])
        >>> figure.axes[1].lines[0].get_ydata()  # half a metre off everywhere
        array([0.5, 0.5, 0.5, 0.5, 0.5])
    """
    if reference.shape != estimate.shape or not len(reference):
        raise ValueError(f"need estimates of the same frames, got {reference.shape} and {estimate.shape} positions")
    u, v = sorted(np.argsort(-np.ptp(reference, axis=0), kind="stable")[:2])
    errors = np.linalg.norm(estimate - reference, axis=1)
    figure, (above, over) = new_figure(9.0, 4.2, columns=2)
    above.plot(reference[:, u], reference[:, v], color="0.6", linewidth=2.5, label="reference")
    points = estimate[:, [u, v]]
    lines = LineCollection(list(np.stack([points[:-1], points[1:]], axis=1)), cmap="viridis", linewidth=1.3)
    lines.set_array(errors[1:])
    above.add_collection(lines)
    above.plot(*points[0], "o", color="black", markersize=4, label="start")
    above.autoscale_view()
    above.set_aspect("equal", adjustable="datalim")
    above.set_xlabel(f"{'xyz'[u]} (m)")
    above.set_ylabel(f"{'xyz'[v]} (m)")
    above.legend(frameon=False, fontsize=8)
    figure.colorbar(lines, ax=above, label="error (m)")
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(reference, axis=0), axis=1))])
    plain(over).plot(along, errors, color="black", linewidth=1.0)
    over.set_xlabel("way along the reference (m)")
    over.set_ylabel("error (m)")
    over.set_ylim(bottom=0)
    return figure
