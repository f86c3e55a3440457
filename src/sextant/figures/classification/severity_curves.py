"""Accuracy against the severity of a corruption."""

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from sextant.figures.style import COLOURS, new_figure, plain


def severity_curves(
    levels: Mapping[str, Sequence[float]],
    accuracy: Mapping[str, Mapping[str, float]],
    intervals: Mapping[str, Mapping[str, tuple[float, float]]] | None = None,
) -> Figure:
    """One panel per corruption, one curve per model; severities are evenly spaced, and clean comes first.

    Args:
        levels: severities by corruption.
        accuracy: by model, then by condition key (``clean`` or ``corruption/level``), in [0, 1].
        intervals: ends of each accuracy's interval, drawn as a band.

    Example:
        >>> figure = severity_curves({"fog": [1, 3]}, {"LeNet": {"clean": 0.99, "fog/1": 0.9, "fog/3": 0.7}})
        >>> [tick.get_text() for tick in figure.axes[0].get_xticklabels()], figure.axes[0].lines[0].get_ydata()
        (['clean', '1', '3'], array([99., 90., 70.]))
    """
    figure, panels = new_figure(4.2 * len(levels), 3.4, columns=len(levels))
    for axes, (corruption, values) in zip(panels, levels.items(), strict=True):
        keys = ["clean", *(f"{corruption}/{level:g}" for level in values)]
        positions = range(len(keys))
        for colour, (model, scores) in zip(COLOURS * 3, accuracy.items(), strict=False):
            axes.plot(positions, [100 * scores[key] for key in keys], "o-", color=colour, label=model, markersize=4)
            if intervals is not None:
                low, high = zip(*(intervals[model][key] for key in keys), strict=True)
                axes.fill_between(positions, [100 * v for v in low], [100 * v for v in high], color=colour, alpha=0.15)
        axes.set_xticks(list(positions), ["clean", *(f"{level:g}" for level in values)])
        axes.set(xlabel=corruption.replace("_", " "), ylabel="accuracy (%)", ylim=(0, 101))
        plain(axes)
    if len(accuracy) > 1:
        panels[0].legend(frameon=False, fontsize=8)
    return figure
