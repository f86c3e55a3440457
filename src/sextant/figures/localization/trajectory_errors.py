"""Localization errors along drives."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy import ndarray

from sextant.evaluation.protocols import LocalizationProtocol
from sextant.figures.style import COLOURS, new_figure, plain

#: An error of exactly zero has no place on a logarithmic axis; it is drawn at this share of the limit.
FLOOR = 1e-3


@dataclass(frozen=True)
class RunErrors:
    """Errors of one run.

    Attributes:
        position: position error of each frame, in the protocol's unit; nan without an estimate.
        heading_deg: heading error of each frame in degrees; None without headings.
        converged: frame at which the run converged; None if it never did.
        kidnapped: frames at which the true pose jumped.
    """

    position: Float[ndarray, " frames"]
    heading_deg: Float[ndarray, " frames"] | None = None
    converged: int | None = None
    kidnapped: tuple[int, ...] = ()


def trajectory_errors(runs: Mapping[str, RunErrors], protocol: LocalizationProtocol) -> Figure:
    """Draw position and heading errors over frames on logarithmic axes, with one curve for each run.

    A dot marks where a run converged, a dotted line where it was kidnapped, and shading what is within the protocol.

    Args:
        runs: errors by name of the run.
        protocol: the limits; without one for the heading there is one panel.

    Raises:
        ValueError: there is no run, or one has no headings where the protocol has a limit for them.

    Example:
        >>> run = RunErrors(np.array([5.0, 2, 0.4, 0.3]), np.array([90.0, 20, 5, 4]), converged=2)
        >>> figure = trajectory_errors({"GP": run}, LocalizationProtocol(0.5, 10.0, 2))
        >>> [axes.get_ylabel() for axes in figure.axes]
        ['position error (m)', 'heading error (°)']
    """
    if not runs:
        raise ValueError("the figure needs at least one run")
    both = protocol.heading_deg is not None
    if both and any(run.heading_deg is None for run in runs.values()):
        raise ValueError("the protocol limits the heading, but a run has no heading errors")
    figure, panels = new_figure(7.2, 4.6 if both else 2.8, rows=2 if both else 1)
    for colour, (name, run) in zip(_colours(len(runs)), runs.items(), strict=True):
        _draw(panels[0], run.position, run, colour, protocol.position, name)
        if protocol.heading_deg is not None and run.heading_deg is not None:
            _draw(panels[1], run.heading_deg, run, colour, protocol.heading_deg, name)
    _finish(panels[0], protocol.position, f"position error ({protocol.unit})")
    if protocol.heading_deg is not None:
        _finish(panels[1], protocol.heading_deg, "heading error (°)")
        panels[1].sharex(panels[0])
    panels[-1].set_xlabel("frame")
    panels[0].legend(frameon=False, fontsize=8, loc="upper right")
    return figure


def _draw(axes: Axes, errors: Float[ndarray, " frames"], run: RunErrors, colour: str, limit: float, name: str) -> None:
    shown = np.maximum(errors, FLOOR * limit)
    axes.plot(np.arange(len(shown)), shown, color=colour, linewidth=1.1, label=name)
    if run.converged is not None:
        axes.plot(
            run.converged, shown[run.converged], "o", color=colour, markersize=6, markeredgecolor="white", zorder=3
        )
    for frame in run.kidnapped:
        axes.axvline(frame, color=colour, linestyle=":", linewidth=1.1)


def _finish(axes: Axes, limit: float, label: str) -> None:
    axes.set_yscale("log")
    bottom = axes.get_ylim()[0]
    axes.axhspan(bottom, limit, color=COLOURS[2], alpha=0.1, linewidth=0)
    axes.set(ylabel=label, ylim=(bottom, None))
    axes.margins(x=0)
    plain(axes)


def _colours(number: int) -> list[str]:
    return [COLOURS[i % len(COLOURS)] for i in range(number)]
