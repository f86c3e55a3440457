"""Whether the predicted uncertainty identifies the images with large errors."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from sextant.evaluation.calibration.sparsification import Sparsification
from sextant.figures.style import COLOURS, new_figure, plain


def sparsification_curves(results: Mapping[str, Sparsification]) -> Figure:
    """One panel per parameter: mean error of the remaining images as the most uncertain are removed.

    The area between the curve and the oracle's is shaded; the titles give it as a share of the area for random order.

    >>> import numpy as np
    >>> from sextant.evaluation.calibration.sparsification import sparsification
    >>> figure = sparsification_curves({"tilt": sparsification(np.array([1.0, 2, 3, 4]), np.array([1.0, 2, 4, 3]))})
    >>> figure.axes[0].get_title().splitlines()
    ['tilt', 'AUSE 0.03 (0.11 of random), Spearman 0.80']
    """
    figure, axes = new_figure(3.0 * len(results), 3.3, columns=len(results))
    for cell, (name, result) in zip(axes, results.items(), strict=True):
        share = 100 * result.removed
        cell.fill_between(share, result.oracle, result.curve, color=COLOURS[0], alpha=0.13, linewidth=0)
        cell.plot(share, result.curve, color=COLOURS[0], label="by predicted uncertainty")
        cell.plot(share, result.oracle, color=COLOURS[2], linestyle="--", label="by error itself (oracle)")
        cell.axhline(1, color="0.4", linestyle=":", label="in random order")
        said = f"{name}\nAUSE {result.ause:.2f} ({result.relative:.2f} of random), Spearman {result.spearman:.2f}"
        cell.set_title(said, fontsize=8)
        cell.set(xlim=(0, 100), xlabel="images taken away (%)")
        cell.set_ylim(0, max(1.15, min(2.0, 1.05 * float(result.curve.max()))))
        plain(cell)
    axes[0].set_ylabel("mean error left / of all")
    handles, labels = axes[0].get_legend_handles_labels()
    columns = 3 if len(results) > 1 else 1
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)
    return figure
