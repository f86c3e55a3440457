"""Success rate of localization by number of particles."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int64
from matplotlib.figure import Figure
from numpy import ndarray

from sextant.evaluation.protocols import ENOUGH_SUCCESS
from sextant.figures.style import COLOURS, new_figure, plain


@dataclass(frozen=True)
class SuccessCurve:
    """Success of one method at several particle counts.

    Attributes:
        counts: numbers of particles, ascending.
        rates: success rates, in [0, 1].
        low, high: ends of the rates' intervals.
    """

    counts: Int64[ndarray, " k"]
    rates: Float[ndarray, " k"]
    low: Float[ndarray, " k"]
    high: Float[ndarray, " k"]

    @property
    def needed(self) -> int | None:
        """The smallest count that suffices; None if none does."""
        enough = np.flatnonzero(self.rates >= ENOUGH_SUCCESS - 1e-9)
        return int(self.counts[enough[0]]) if len(enough) else None


def success_curves(curves: Mapping[str, SuccessCurve], title: str = "") -> Figure:
    """Draw one curve with intervals for each method; the legend gives the number of particles it needs.

    Args:
        curves: curves by the name of the method.
        title: title, such as the protocol.

    Raises:
        ValueError: there is no curve.

    Example:
        >>> rates = np.array([0.6, 0.97])
        >>> curve = SuccessCurve(np.array([100, 1000]), rates, rates - 0.1, np.array([0.7, 1.0]))
        >>> curve.needed
        1000
        >>> success_curves({"GP": curve}).axes[0].get_legend().get_texts()[0].get_text()
        'GP  1,000'
    """
    if not curves:
        raise ValueError("the figure needs at least one curve")
    figure, (axes,) = new_figure(5.6, 3.8)
    for number, (name, curve) in enumerate(curves.items()):
        colour = COLOURS[number % len(COLOURS)]
        needed = f"> {curve.counts[-1]:,}" if curve.needed is None else f"{curve.needed:,}"
        shift = 1.04 ** (number - (len(curves) - 1) / 2)  # intervals of several methods stand side by side
        below, above = (np.maximum(part, 0) for part in (curve.rates - curve.low, curve.high - curve.rates))
        axes.errorbar(
            curve.counts * shift,
            100 * curve.rates,
            100 * np.stack([below, above]),
            color=colour,
            marker="o",
            markersize=4,
            linewidth=1.3,
            elinewidth=0.9,
            capsize=2,
            label=f"{name}  {needed}",
        )
    axes.axhline(100 * ENOUGH_SUCCESS, color="#888888", linestyle="--", linewidth=0.8)
    axes.set_xscale("log")
    counts = np.unique(np.concatenate([curve.counts for curve in curves.values()]))
    axes.set_xticks(counts, [f"{count:,}" for count in counts])
    axes.minorticks_off()
    axes.set(xlabel="particles", ylabel="runs that converged (%)", ylim=(-2, 102))
    axes.set_title(title, fontsize=9)
    plain(axes)
    axes.legend(
        title=f"particles for {100 * ENOUGH_SUCCESS:g} %", frameon=False, fontsize=8, title_fontsize=8, loc="best"
    )
    return figure
