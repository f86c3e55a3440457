"""Trajectories and their errors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, UInt8
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy import ndarray

from sextant.evaluation.protocols import LocalizationProtocol
from sextant.figures.style import COLOURS, new_figure, plain, shortened

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

    A dot marks where a run converged, a dotted line where it was kidnapped, and shading the limits of the protocol.

    Args:
        runs: errors by name of the run.
        protocol: the limits; without a limit for the heading there is only one panel.

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
    over.set_xlabel("distance along the reference (m)")
    over.set_ylabel("error (m)")
    over.set_ylim(bottom=0)
    return figure


#: letters of a title that fit above an image
LONGEST = 26
ROWS = ("as taken", "straightened", "nearest map image")


@dataclass(frozen=True)
class WalkedImage:
    """One image of a walk.

    Attributes:
        title: title, such as the file and place.
        taken: the image as the camera took it.
        straight: the image as the virtual camera would have taken it.
        mapped: the nearest image of the map; None if it is not known.
    """

    title: str
    taken: UInt8[ndarray, "h w 3"]
    straight: UInt8[ndarray, "vh vw 3"]
    mapped: UInt8[ndarray, "vh vw 3"] | None


def straightened_walk(images: Sequence[WalkedImage]) -> Figure:
    """Draw one column for each image, and a row for each stage of its processing.

    >>> import numpy as np
    >>> taken, straight = np.zeros((30, 40, 3), np.uint8), np.zeros((24, 32, 3), np.uint8)
    >>> figure = straightened_walk([WalkedImage(place, taken, straight, None) for place in ("hall", "stairs")])
    >>> len(figure.axes), figure.axes[0].get_title(), figure.axes[2].get_ylabel()
    (4, 'hall', 'straightened')
    """
    stages = [[each.taken, each.straight, *([] if each.mapped is None else [each.mapped])] for each in images]
    rows, columns = max(map(len, stages)), len(images)
    figure, axes = new_figure(1.7 * columns + 0.3, 1.35 * rows + 0.2, rows=rows, columns=columns)
    for column, (image, pictures) in enumerate(zip(images, stages, strict=True)):
        for row in range(rows):
            cell = axes[row * columns + column]
            cell.set_xticks([])
            cell.set_yticks([])
            if row < len(pictures):
                cell.imshow(pictures[row], cmap="gray", vmin=0, vmax=255)
            if column == 0:
                cell.set_ylabel(ROWS[row], fontsize=7)
        axes[column].set_title(shortened(image.title, LONGEST), fontsize=7, pad=2)
    return figure
