"""Coverage of intervals against their nominal level."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from sextant.evaluation.conformal import CoverageCurve
from sextant.figures.style import COLOURS, new_figure, plain


def coverage_curves(curve: CoverageCurve, names: Sequence[str]) -> Figure:
    """One curve per parameter with its 95 % band over panoramas; below the diagonal intervals are too short.

    Args:
        curve: coverage of k parameters.
        names: names of the k parameters.

    Example:
        >>> import numpy as np
        >>> levels, share = np.array([0.5, 0.9]), np.array([[0.4], [0.85]])
        >>> curve = CoverageCurve(levels, share, share - 0.1, share + 0.1, multipliers=np.ones((2, 1)))
        >>> _, line = coverage_curves(curve, ["tilt"]).axes[0].lines  # the first is the diagonal
        >>> line.get_ydata()
        array([40., 85.])
    """
    figure, (axes,) = new_figure(4.6, 4.4)
    axes.plot([0, 100], [0, 100], color="black", linewidth=0.9, label="as stated")
    for colour, name, share, low, high in zip(
        COLOURS, names, curve.coverage.T, curve.low.T, curve.high.T, strict=False
    ):
        axes.plot(100 * curve.levels, 100 * share, "o-", color=colour, label=name, markersize=3, linewidth=1.4)
        axes.fill_between(100 * curve.levels, 100 * low, 100 * high, color=colour, alpha=0.13, linewidth=0)
    axes.set(xlim=(0, 100), ylim=(0, 100), aspect="equal")
    axes.set(xlabel="level of the intervals (%)", ylabel="test images whose interval holds the truth (%)")
    axes.legend(frameon=False, fontsize=9, loc="upper left")
    plain(axes)
    return figure
