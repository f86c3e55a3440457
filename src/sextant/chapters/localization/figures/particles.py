"""Pictures and animations of particles over a map."""

import io
import struct
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from numpy import ndarray
from PIL import Image

from sextant.errors import UserError
from sextant.figures.style import COLOURS, new_figure, printable

PIXELS_PER_INCH = 100
#: width of the images beside the map, in inches
SEEN_WIDTH = 2.4


@dataclass(frozen=True)
class ParticleFrame:
    """One step of a filter.

    Attributes:
        poses: poses of the particles, x, y in the unit of the map and heading in radians.
        log_weights: log weights up to a constant.
        estimate: estimated pose; None while lost.
        truth: true pose; None where it is unknown.
        title: title, such as the number of the frame.
        path: true positions so far.
        covariance: covariance of the estimate's x and y, drawn as an ellipse that holds 95 %; None draws none.
        seen: the camera's image; None shows none.
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


class ParticleView:
    """Draws steps of a filter on one figure with a fixed layout.

    Args:
        map_positions: positions of the map's images.
        width: width of the map in inches of 100 pixels.
        unit: unit of positions.
        seen: leave room beside the map for the camera's image and the map's image nearest to the estimate.
        walls: points on walls, if they are known.

    Raises:
        ValueError: the map has no position.

    Example:
        >>> corridor = np.column_stack([np.arange(9.0), np.zeros(9)])
        >>> view = ParticleView(corridor, width=4.0)
        >>> view.draw(ParticleFrame(np.zeros((5, 3)), np.zeros(5))).shape
        (280, 400, 3)
    """

    def __init__(
        self,
        map_positions: Float[ndarray, "n 2"],
        *,
        width: float = 6.0,
        unit: str = "m",
        seen: bool = False,
        walls: Float[ndarray, "w 2"] | None = None,
    ):
        if len(map_positions) == 0:
            raise ValueError("a view needs a map with at least one position")
        height = map_height(map_positions, width)
        self._beside: list[Axes] = []
        if seen:
            self._figure = Figure(figsize=(width + SEEN_WIDTH, max(height, 4.0)), layout="constrained")
            grid = self._figure.add_gridspec(2, 2, width_ratios=(SEEN_WIDTH, width))
            self._beside = [self._figure.add_subplot(grid[row, 0]) for row in (0, 1)]
            self._axes = self._figure.add_subplot(grid[:, 1])
            for axes, title in zip(self._beside, ("the camera", "the map, nearest to the estimate"), strict=True):
                axes.set_title(title, fontsize=9)
                axes.axis("off")
        else:
            self._figure, (self._axes,) = new_figure(width, height)
        self._canvas = FigureCanvasAgg(self._figure)
        self._figure.set_dpi(PIXELS_PER_INCH)
        draw_map(self._axes, map_positions, unit, walls)
        self._below: Any = None  # background shared by all pictures, once the first has placed the axes

    def draw(self, frame: ParticleFrame) -> UInt8[ndarray, "h w 3"]:
        """Draw the picture of one step; both sides have an even number of pixels, as video codecs require."""
        artists = draw_frame(self._axes, frame)
        for axes, image in zip(self._beside, (frame.seen, frame.there), strict=False):
            if image is not None:
                grey = image.shape[-1] == 1
                artists.append(axes.imshow(image[..., 0] if grey else image, cmap="gray" if grey else None))
                axes.apply_aspect()  # of this image, if earlier ones had another aspect or there was none
        if self._below is None:
            draw_legend(self._figure, truth=frame.truth is not None)
            self._place(artists)
        self._canvas.restore_region(self._below)
        renderer = self._canvas.get_renderer()
        for artist in (*sorted(artists, key=Artist.get_zorder), self._axes.title):
            artist.draw(renderer)
        picture = np.asarray(self._canvas.buffer_rgba())[..., :3]
        picture = np.ascontiguousarray(picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2])
        for artist in artists:
            artist.remove()
        return picture

    def _place(self, artists: list[Artist]) -> None:
        """Lay out the figure and keep its unchanging part, as redrawing a large map takes longer than all the rest."""
        self._canvas.draw()
        self._figure.set_layout_engine("none")  # the axes stay where the first frame puts them
        changing = [*artists, self._axes.title]
        for artist in changing:
            artist.set_visible(False)
        self._canvas.draw()
        self._below = self._canvas.copy_from_bbox(self._figure.bbox)
        for artist in changing:
            artist.set_visible(True)


TRUTH, ESTIMATE, MAP, WALLS, WEIGHTS = COLOURS[2], COLOURS[1], "#a5a39c", "#55534c", "plasma_r"
#: Number of orders of magnitude below the largest weight over which weights are coloured.
DECADES = 4
#: Largest number of map positions drawn, evenly spaced; more could not be distinguished.
MOST_POSITIONS = 20_000
#: Largest number of particles whose headings are drawn, the heaviest ones.
MOST_HEADINGS = 300
#: Squared Mahalanobis distance that holds 95 % of a normal distribution in the plane.
CHI2_95 = 5.991


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

    Particles are coloured by weight on a logarithmic scale down to 10⁻⁴ of the largest, with light ones underneath. A
    stroke points along the heading of each of the 300 heaviest, an arrow along those of the estimate and the truth.

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


class _Writer(Protocol):
    def write(self, image: UInt8[ndarray, "h w 3"]) -> None: ...

    def close(self) -> None: ...


def particle_replay(
    map_positions: Float[ndarray, "n 2"],
    frames: Iterable[ParticleFrame],
    path: Path,
    *,
    frames_per_second: float = 10.0,
    width: float = 6.0,
    unit: str = "m",
    seen: bool = False,
    walls: Float[ndarray, "w 2"] | None = None,
) -> int:
    """Write a video (``.mp4``) or an animation that any browser shows (``.gif``), and return the number of frames.

    Frames are drawn and written as they come, so memory does not grow with their number if they come from a generator.
    The file appears when it is complete.

    Args:
        map_positions: positions of the map's images.
        frames: the steps, in order.
        path: path of the file to write; its folder is created.
        frames_per_second: speed of the animation.
        width: width of the map in inches of 100 pixels.
        unit: unit of positions.
        seen: show the frames' images beside the map.
        walls: points on walls, if they are known.

    Raises:
        UserError: the path has another suffix, there is no frame, or no MP4 can be written on this machine.
        ValueError: the map has no position.

    Example:
        >>> import tempfile
        >>> corridor = np.column_stack([np.arange(9.0), np.zeros(9)])
        >>> frames = [ParticleFrame(np.array([[float(x), 0, 0]]), np.zeros(1)) for x in range(2)]
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     particle_replay(corridor, frames, Path(folder, "replay.gif"), width=2.0)
        2
    """
    if path.suffix not in (".gif", ".mp4"):
        raise UserError(f"{path}: a replay is written as .gif or .mp4", f"Try {path.with_suffix('.gif')}")
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.stem}.unfinished{path.suffix}")
    view: ParticleView | None = None
    writer: _Writer | None = None
    count = 0
    try:
        for frame in frames:
            if view is None:
                view = ParticleView(map_positions, width=width, unit=unit, seen=seen, walls=walls)
            image = view.draw(frame)
            if writer is None:
                writer = (_Gif if path.suffix == ".gif" else _Mp4)(unfinished, frames_per_second, image.shape)
            writer.write(image)
            count += 1
        if writer is None:
            raise UserError("a replay needs at least one frame", "Run the filter for longer")
        writer.close()
        writer = None
        unfinished.replace(path)
    finally:
        if writer is not None:
            writer.close()
        unfinished.unlink(missing_ok=True)
    return count


class _Gif:
    """Appends each image to the file at once, with its own colour table.

    An animation is a header, a block that requests repetition, and images one after the other. Pillow writes each image
    as a separate GIF, whose global colour table becomes a local one here. (The animations of matplotlib and Pillow hold
    all frames until the end.) Format: CompuServe, "Graphics Interchange Format, version 89a", 1990.
    """

    def __init__(self, path: Path, frames_per_second: float, shape: tuple[int, ...]):
        self._centiseconds = max(2, round(100 / frames_per_second))  # browsers slow down faster animations
        self._file = path.open("wb")
        height, width = shape[:2]
        self._file.write(b"GIF89a" + struct.pack("<HHBBB", width, height, 0, 0, 0))
        self._file.write(b"\x21\xff\x0bNETSCAPE2.0\x03\x01" + struct.pack("<HB", 0, 0))

    def write(self, image: UInt8[ndarray, "h w 3"]) -> None:
        whole = io.BytesIO()
        picture = Image.fromarray(image).quantize(128, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
        picture.save(whole, "GIF", interlace=0)
        data = whole.getvalue()
        size = data[10] & 7  # the table has 2^(size + 1) colours
        colours = data[13 : 13 + 3 * 2 ** (size + 1)]
        at = 13 + len(colours)
        while data[at] == 0x21:  # extensions: a label, then blocks up to an empty one
            at += 2
            while data[at]:
                at += data[at] + 1
            at += 1
        placed, pixels = data[at : at + 9], data[at + 10 : -1]  # without the flags, and without the file's end
        self._file.write(b"\x21\xf9\x04" + struct.pack("<BHBB", 4, self._centiseconds, 0, 0))
        self._file.write(placed + bytes([0x80 | size]) + colours + pixels)

    def close(self) -> None:
        self._file.write(b"\x3b")
        self._file.close()


class _Mp4:
    def __init__(self, path: Path, frames_per_second: float, shape: tuple[int, ...]):
        import cv2

        codec = cv2.VideoWriter.fourcc(*"mp4v")
        self._video = cv2.VideoWriter(str(path), codec, frames_per_second, (shape[1], shape[0]))
        if not self._video.isOpened():
            raise UserError(f"{path}: OpenCV cannot write MP4 on this machine", f"Try {path.with_suffix('.gif')}")

    def write(self, image: UInt8[ndarray, "h w 3"]) -> None:
        self._video.write(np.ascontiguousarray(image[..., ::-1]))

    def close(self) -> None:
        self._video.release()
