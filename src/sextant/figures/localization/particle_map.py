"""Particles over the map, seen from above."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from numpy import ndarray

from sextant.figures.style import COLOURS, printable

TRUTH, ESTIMATE, MAP, WALLS, WEIGHTS = COLOURS[2], COLOURS[1], "#a5a39c", "#55534c", "plasma_r"
#: Number of orders of magnitude below the largest weight over which weights are coloured.
DECADES = 4
#: Largest number of map positions drawn, evenly chosen; more could not be told apart.
MOST_POSITIONS = 20_000
#: Largest number of particles whose headings are drawn, the heaviest ones.
MOST_HEADINGS = 300
#: Squared Mahalanobis distance that holds 95 % of a normal distribution in the plane.
CHI2_95 = 5.991


@dataclass(frozen=True)
class ParticleFrame:
    """One moment of a filter.

    Attributes:
        poses: poses of the particles, x, y in the unit of the map and heading in radians.
        log_weights: log weights up to a constant.
        estimate: estimated pose; None while lost.
        truth: true pose; None where it is not known.
        title: title, such as the number of the frame.
        path: true positions so far.
        covariance: covariance of the estimate's x and y, drawn as an ellipse that holds 95 %; None draws none.
        seen: what the camera sees, if it is to be shown.
        there: the image of the map nearest to the estimate.
    """

    poses: Float[ndarray, "p 3"]
    log_weights: Float[ndarray, " p"]
    estimate: Float[ndarray, "3"] | None = None
    truth: Float[ndarray, "3"] | None = None
    title: str = ""
    path: Float[ndarray, "k 2"] = field(default_factory=lambda: np.zeros((0, 2)))
    covariance: Float[ndarray, "2 2"] | None = None
    seen: UInt8[ndarray, "h w c"] | None = None
    there: UInt8[ndarray, "h w c"] | None = None


def map_height(map_positions: Float[ndarray, "n 2"], width: float) -> float:
    """A suitable height in inches for a figure of a map, including labels.

    >>> map_height(np.array([[0.0, 0], [30, 20]]), width=6.0) > map_height(np.array([[0.0, 0], [30, 0]]), width=6.0)
    True
    """
    across, along = np.subtract(*reversed(_bounds(map_positions)))
    return float(np.clip(width * along / across, 2.0, 2 * width)) + 0.8


def draw_map(
    axes: Axes, map_positions: Float[ndarray, "n 2"], unit: str = "m", walls: Float[ndarray, "w 2"] | None = None
) -> None:
    """Draw a map's positions and set the limits of the axes.

    Args:
        axes: axes to draw on.
        map_positions: positions of the map's images.
        unit: unit of positions, such as frames along a railway.
        walls: points on walls, such as the occupied cells of a grid, if they are known.

    Example:
        >>> from sextant.figures.style import new_figure
        >>> figure, (axes,) = new_figure(4.0, 3.0)
        >>> draw_map(axes, np.array([[0.0, 0], [30, 20]]))
        >>> axes.get_xlabel(), np.array(axes.get_xlim())  # with a margin
        ('x (m)', array([-1.5, 31.5]))
    """
    (left, bottom), (right, top) = _bounds(map_positions if walls is None else np.vstack([map_positions, walls]))
    if walls is not None:
        axes.scatter(walls[:, 0], walls[:, 1], s=0.6, color=WALLS, linewidths=0, rasterized=True)
    some = map_positions[:: -(-len(map_positions) // MOST_POSITIONS)]
    axes.scatter(some[:, 0], some[:, 1], s=3, color=MAP, linewidths=0, rasterized=True)
    names = {"xlabel": f"x ({unit})", "ylabel": f"y ({unit})"}
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", **names)


def draw_legend(figure: Figure, *, truth: bool) -> None:
    """Explain the colours of frames over a map in a legend below; ``truth``: whether true poses are known.

    >>> from sextant.figures.style import new_figure
    >>> figure, _ = new_figure(4.0, 3.0)
    >>> draw_legend(figure, truth=False)
    >>> [text.get_text() for text in figure.legends[0].get_texts()]
    ['map', 'particles (dark: heavy)', 'estimate']
    """
    marks = {"map": (MAP, 2), "particles (dark: heavy)": (to_hex(colormaps[WEIGHTS](1.0)), 3)}
    marks |= {"truth": (TRUTH, 6)} if truth else {}
    marks["estimate"] = (ESTIMATE, 6)
    handles = [Line2D([], [], color=c, marker="o", markersize=s, ls="", label=name) for name, (c, s) in marks.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize=7)


def draw_frame(axes: Axes, frame: ParticleFrame) -> list[Artist]:
    """Draw what changes from frame to frame on axes with a map, and return its artists except for the title.

    Particles are coloured by weight on a logarithmic scale down to 10⁻⁴ of the largest, light ones below. A stroke
    points along the heading of each of the 300 heaviest, and an arrow along that of the estimate and of the truth.

    >>> from sextant.figures.style import new_figure
    >>> figure, (axes,) = new_figure(4.0, 3.0)
    >>> particles = np.array([[1.0, 2, 0], [3, 4, 0]])
    >>> dots, strokes = draw_frame(axes, ParticleFrame(particles, np.log([0.9, 0.1]), title="frame 7"))
    >>> dots.get_offsets().tolist(), axes.get_title()  # the heaviest is drawn last
    ([[3.0, 4.0], [1.0, 2.0]], 'frame 7')
    """
    arrow_m = 0.06 * max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()))
    order = np.argsort(frame.log_weights)
    share = np.exp(np.maximum(frame.log_weights - frame.log_weights.max(), -DECADES * np.log(10)))
    dots = axes.scatter(
        frame.poses[order, 0],
        frame.poses[order, 1],
        c=share[order],
        norm=LogNorm(10.0**-DECADES, 1.0),
        cmap=WEIGHTS,
        s=7,
        linewidths=0,
    )
    heavy = order[-MOST_HEADINGS:]
    starts = frame.poses[heavy, :2]
    ahead = 0.4 * arrow_m * np.column_stack([np.cos(frame.poses[heavy, 2]), np.sin(frame.poses[heavy, 2])])
    strokes = LineCollection(
        np.stack([starts, starts + ahead], axis=1).tolist(), colors=dots.to_rgba(share[heavy]), linewidths=0.6
    )
    axes.add_collection(strokes, autolim=False)
    artists: list[Artist] = [dots, strokes]
    axes.set_title(printable(frame.title), fontsize=9, y=1.0)
    if len(frame.path):
        artists += axes.plot(*frame.path.T, color=TRUTH, linewidth=1.0, alpha=0.7)
    if frame.estimate is not None and frame.covariance is not None:
        artists.append(axes.add_patch(_ellipse(frame.estimate[:2], frame.covariance)))
    for pose, colour in ((frame.truth, TRUTH), (frame.estimate, ESTIMATE)):
        if pose is None:
            continue
        x, y, heading = pose
        artists += axes.plot(x, y, "o", color=colour, markersize=6, markeredgecolor="white")
        artists.append(
            axes.annotate(
                "",
                (x + arrow_m * np.cos(heading), y + arrow_m * np.sin(heading)),
                (x, y),
                arrowprops={"arrowstyle": "->", "color": colour, "linewidth": 1.6},
            )
        )
    return artists


def _ellipse(middle: Float[ndarray, "2"], covariance: Float[ndarray, "2 2"]) -> Ellipse:
    """The ellipse that holds 95 % of a normal distribution."""
    variances, axes = np.linalg.eigh(covariance)
    height, width = 2 * np.sqrt(CHI2_95 * np.clip(variances, 0.0, None))
    angle = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))  # of the longer axis
    return Ellipse((middle[0], middle[1]), width, height, angle=angle, fill=False, edgecolor=ESTIMATE, linewidth=1.2)


def _bounds(positions: Float[ndarray, "n 2"]) -> tuple[Float[ndarray, "2"], Float[ndarray, "2"]]:
    low, high = positions.min(axis=0), positions.max(axis=0)
    # a railway has no width: it is given a tenth of its length, so that the particles beside it are visible
    margin = np.maximum(0.03 * (high - low), max(0.05 * float((high - low).max()), 1.0))
    return low - margin, high + margin
