"""Cameras drawn over their photos: horizon, directions and grids."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib.patheffects as effects
import numpy as np
import torch
from jaxtyping import Float, UInt8
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import Normal, Stroke
from numpy import ndarray
from PIL import Image
from torch import Tensor

from sextant.chapters.calibration.figures.errors import camera_quantities
from sextant.figures.style import COLOURS, new_figure, printable, shortened
from sextant.geometry import (
    CameraParameters,
    K2Family,
    k2_of_k1,
    max_distorted_radius,
    perspective_bearings,
    perspective_project,
    rotation_from_tilt_roll,
    undistort_radius,
    up_in_camera,
)


def horizon_curve(
    tilt: Float[Tensor, ""],
    roll: Float[Tensor, ""],
    focal: Float[Tensor, ""],
    k1: Float[Tensor, ""],
    k2: Float[Tensor, ""],
    *,
    reach: float = math.inf,
    points: int = 4001,
) -> Float[ndarray, "p 2"]:
    """Points of one camera's horizon in image heights from the centre, left to right; nan where it is not visible.

    It accepts any camera, even one whose lens folds inside the image, which a camera object would reject.

    Args:
        tilt: radians, positive upward.
        roll: radians.
        focal: image heights.
        k1: first coefficient of distortion.
        k2: second coefficient.
        reach: points farther than this from the centre are nan too, since they would be clipped.
        points: number of points, at even azimuths in front of the camera.

    Example:
        >>> none, focal = torch.tensor(0.0), torch.tensor(1.0)
        >>> horizon_curve(none, none, focal, none, none, points=3).round(3)  # a level camera's is a level line
        array([[-1.,  0.],
               [ 0.,  0.],
               [ 1.,  0.]])
    """
    azimuths = torch.linspace(-math.pi / 2, math.pi / 2, points + 2, dtype=torch.float64)[1:-1]
    level = torch.stack([torch.sin(azimuths), torch.zeros_like(azimuths), torch.cos(azimuths)], -1)
    tilt, roll, focal, k1, k2 = (value.detach().double().cpu() for value in (tilt, roll, focal, k1, k2))
    curve, visible = perspective_project(level @ rotation_from_tilt_roll(tilt, roll), focal, k1, k2)
    near = torch.linalg.vector_norm(curve, dim=-1) < reach
    return torch.where((visible & near)[:, None], curve, torch.nan).numpy()


HORIZON, GRAVITY, GRID, SEEN = "#E69F00", "#56B4E9", "#FFFFFF", "#CC79A7"
LONGEST_SIDE = 1200
SHEET_COLUMNS, SHEET_SIDE = 4, 420
#: letters of a caption that fit above a photo of the sheet
LONGEST_CAPTION = 52
LINES_PER_HALF_HEIGHT, MOST_LINES = 4, 60
ARROWS, ARROW_LENGTH = 6, 0.07  # along the height, and image heights
FAR = 2.0  # image diagonals from the centre; anything beyond would only be clipped
STEP = 1e-4  # radians towards the nadir, for the direction of an arrow


@dataclass(frozen=True)
class CalibratedPhoto:
    """A photo and its camera.

    Attributes:
        image: RGB bytes of any size.
        tilt: radians, positive upward.
        roll: radians.
        focal: image heights of ``image``.
        k1: first coefficient of distortion.
        k2: second coefficient.
        seen: left, top, width and height of the part given to the network, as shares of the image's sides.
        caption: lines of text.

    Example:
        >>> image = np.zeros((60, 80, 3), np.uint8)
        >>> from dataclasses import replace
        >>> level = CalibratedPhoto(image, tilt=0.0, roll=0.0, focal=0.7, k1=0.0, k2=0.0, seen=(0, 0, 1, 1))
        >>> level.horizon_is(), replace(level, tilt=1.2).horizon_is()  # looking up
        ('in the picture', 'below the picture')
    """

    image: UInt8[ndarray, "h w 3"]
    tilt: float
    roll: float
    focal: float
    k1: float
    k2: float
    seen: tuple[float, float, float, float]
    caption: Sequence[str] = ()

    @property
    def aspect(self) -> float:
        """Width over height."""
        height, width = self.image.shape[:2]
        return float(width / height)

    def lens(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Focal length and the two coefficients as tensors."""
        focal, k1, k2 = (torch.tensor(value, dtype=torch.float64) for value in (self.focal, self.k1, self.k2))
        return focal, k1, k2

    def horizon(self) -> Float[ndarray, "n 2"]:
        """Points of the horizon from left to right, in image heights from the centre; nan where it is not visible."""
        tilt, roll = (torch.tensor(value, dtype=torch.float64) for value in (self.tilt, self.roll))
        return horizon_curve(tilt, roll, *self.lens(), reach=FAR * math.hypot(self.aspect, 1))

    def horizon_is(self) -> str:
        """Where the horizon is: in the picture, or on the side of it where its foot ``ρ (sin ψ, cos ψ)`` lies."""
        if (np.abs(self.horizon()) <= [self.aspect / 2, 0.5]).all(1).any():
            return "in the picture"
        sign = math.copysign(1, self.tilt)  # that of ρ
        right, down = sign * math.sin(self.roll) / self.aspect, sign * math.cos(self.roll)
        if abs(right) > abs(down):
            return f"to the {'right' if right > 0 else 'left'} of the picture"
        return f"{'below' if down > 0 else 'above'} the picture"


def calibration_overlay(photo: CalibratedPhoto) -> Figure:
    """One photo with horizon, gravity arrows, the image of a square grid, and the part given to the network.

    >>> image = np.zeros((60, 80, 3), np.uint8)
    >>> photo = CalibratedPhoto(image, tilt=0.1, roll=0.0, focal=0.7, k1=-0.2, k2=0.0, seen=(0.1, 0, 0.8, 1))
    >>> axes = calibration_overlay(photo).axes[0]
    >>> axes.get_legend().get_texts()[-1].get_text()
    'input of the network'
    """
    width = 8 * min(1.0, max(photo.aspect, 0.35))
    picture = min(width / photo.aspect, 9)
    figure, (axes,) = new_figure(max(width, 4.5), picture + 0.25 * len(photo.caption) + 0.5)
    _draw(axes, photo, LONGEST_SIDE, 1.0)
    axes.set_title(printable("\n".join(photo.caption)), fontsize=9, loc="left")
    handles: list[Artist] = [
        Line2D([], [], color=HORIZON, linewidth=2.5, label=f"horizon ({photo.horizon_is()})"),
        Line2D([], [], color=GRAVITY, marker=">", label="gravity"),
        Line2D([], [], color="#999999", linewidth=1, label="straight lines as the lens shows them"),
    ]
    if not _is_whole(photo.seen):
        handles.append(Patch(facecolor="none", edgecolor=SEEN, linestyle="--", label="input of the network"))
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.01), ncols=2, fontsize=8, frameon=False)
    return figure


def photo_sheet(photos: Sequence[CalibratedPhoto]) -> Figure:
    """Many photos, four per row, each with its overlay and caption.

    >>> photo = CalibratedPhoto(np.zeros((60, 80, 3), np.uint8), 0.1, 0.0, 0.7, -0.2, 0.0, (0, 0, 1, 1))
    >>> figure = photo_sheet([photo] * 5)
    >>> [len(axes.images) for axes in figure.axes]
    [1, 1, 1, 1, 1, 0, 0, 0]
    """
    columns = min(SHEET_COLUMNS, len(photos))
    rows = -(-len(photos) // columns)
    lines = max(len(photo.caption) for photo in photos)
    figure, axes = new_figure(3.2 * columns, (2.5 + 0.16 * lines) * rows, rows=rows, columns=columns)
    for cell in axes[len(photos) :]:
        cell.axis("off")
    for cell, photo in zip(axes, photos, strict=False):
        _draw(cell, photo, SHEET_SIDE, 0.45)
        cell.set_title(shortened("\n".join(photo.caption), LONGEST_CAPTION), fontsize=7, loc="left")
    return figure


def gravity_arrows(photo: CalibratedPhoto) -> tuple[Float[ndarray, "n 2"], Float[ndarray, "n 2"]]:
    """Points on a regular grid over the image, in image heights from the centre, and unit vectors pointing down.

    >>> level = CalibratedPhoto(np.zeros((60, 80, 3), np.uint8), 0.0, 0.0, 0.7, 0.0, 0.0, (0, 0, 1, 1))
    >>> points, down = gravity_arrows(level)
    >>> points.shape, bool(np.allclose(down, [0, 1], atol=1e-4))  # v grows downward
    ((48, 2), True)
    """
    across = max(2, round(ARROWS * photo.aspect))
    v = (torch.arange(ARROWS, dtype=torch.float64) + 0.5) / ARROWS - 0.5
    u = ((torch.arange(across, dtype=torch.float64) + 0.5) / across - 0.5) * photo.aspect
    points = torch.cartesian_prod(u, v)
    focal, k1, k2 = photo.lens()
    reached = torch.linalg.vector_norm(points, dim=-1) < focal * max_distorted_radius(k1, k2)
    points = points[reached]
    rays = perspective_bearings(points, focal, k1, k2)
    up = up_in_camera(torch.tensor(photo.tilt, dtype=torch.float64), torch.tensor(photo.roll, dtype=torch.float64))
    down = -(up - (rays @ up)[:, None] * rays)  # at right angles to the ray: it vanishes at zenith and nadir
    moved, _ = perspective_project(rays + STEP * down, focal, k1, k2)
    direction = moved - points
    length = torch.linalg.vector_norm(direction, dim=-1, keepdim=True)
    return points.numpy(), (direction / length.clamp(min=1e-12)).numpy()


def distortion_grid(photo: CalibratedPhoto) -> list[Float[ndarray, "n 2"]]:
    """Lines straight in the scene, as they appear in the image, in image heights from the centre.

    They form a square grid at right angles to the viewing direction that covers the image.

    >>> photo = CalibratedPhoto(np.zeros((60, 80, 3), np.uint8), 0.0, 0.0, 0.7, 0.0, 0.0, (0, 0, 1, 1))
    >>> lines = distortion_grid(photo)
    >>> len(lines), float(np.nanstd(lines[0][:, 0]).round(6))  # upright, and straight without distortion
    (30, 0.0)
    """
    focal, k1, k2 = photo.lens()
    radii = torch.tensor([0.5, math.hypot(photo.aspect, 1) / 2], dtype=torch.float64)
    half, corner = undistort_radius(radii / focal, k1, k2).tolist()
    spacing = max(half / LINES_PER_HALF_HEIGHT, 2 * corner / MOST_LINES)
    count = math.ceil(corner / spacing)
    along = torch.linspace(-corner, corner, 401, dtype=torch.float64)
    lines = []
    for i in range(-count, count + 1):
        fixed = torch.full_like(along, i * spacing)
        one = torch.ones_like(along)
        lines += [_project(torch.stack(xy, -1), photo) for xy in ([fixed, along, one], [along, fixed, one])]
    return lines


def _draw(axes: Axes, photo: CalibratedPhoto, longest: int, weight: float) -> None:
    """Draw a photo and its overlay with line widths times ``weight``."""
    aspect = photo.aspect
    extent = (-aspect / 2, aspect / 2, 0.5, -0.5)
    axes.imshow(_shrunk(photo.image, longest), extent=extent, interpolation="antialiased")
    outline = [effects.withStroke(linewidth=4.5 * weight, foreground="#000000", alpha=0.6)]
    shadow: list[effects.AbstractPathEffect] = [
        effects.withStroke(linewidth=2 * weight, foreground="#000000", alpha=0.25)
    ]  # white would vanish against a bright sky
    grid = LineCollection(distortion_grid(photo), colors=GRID, linewidths=0.9 * weight, alpha=0.7)
    grid.set_path_effects(shadow)
    axes.add_collection(grid)
    points, down = gravity_arrows(photo)
    start, arrow = points - ARROW_LENGTH / 2 * down, ARROW_LENGTH * down
    axes.quiver(
        *start.T,
        *arrow.T,
        angles="xy",
        scale_units="xy",
        scale=1,
        units="xy",
        width=0.008,
        headlength=4,
        headaxislength=4,
        color=GRAVITY,
        edgecolor="#000000",
        linewidth=0.9 * weight,
    )
    axes.plot(*photo.horizon().T, color=HORIZON, linewidth=2.5 * weight, path_effects=outline)
    if not _is_whole(photo.seen):
        left, top, width, height = photo.seen
        box = ((left - 0.5) * aspect, top - 0.5)
        axes.add_patch(
            Rectangle(box, width * aspect, height, fill=False, edgecolor=SEEN, linestyle="--", linewidth=2 * weight)
        )
    axes.set(xlim=extent[:2], ylim=extent[2:])
    axes.axis("off")


def _project(directions: torch.Tensor, photo: CalibratedPhoto) -> Float[ndarray, "n 2"]:
    points, seen = perspective_project(directions, *photo.lens())
    near = torch.linalg.vector_norm(points, dim=-1) < FAR * math.hypot(photo.aspect, 1)
    return torch.where((seen & near)[:, None], points, torch.nan).numpy()


def _is_whole(seen: tuple[float, float, float, float]) -> bool:
    return seen[2] > 0.99 and seen[3] > 0.99


def _shrunk(image: UInt8[ndarray, "h w 3"], longest: int) -> UInt8[ndarray, "h w 3"]:
    factor = longest / max(image.shape[:2])
    if factor >= 1:
        return image
    size = (max(1, round(image.shape[1] * factor)), max(1, round(image.shape[0] * factor)))
    return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BOX))


COLUMNS = 4
WIDTH, TEXT = 2.9, 0.95  # inches of a cell, and of the numbers beneath
POINTS = 361
ROWS = (("tilt", "tilt", "{:+6.1f}°"), ("roll", "roll", "{:+6.1f}°"), ("vfov", "vfov", "{:6.1f}°"),
        ("k1/f²", "k1_hat", "{:+7.2f}"))  # fmt: skip
STYLES: tuple[dict[str, Any], ...] = (
    {"color": COLOURS[5], "linestyle": "-"},
    {"color": COLOURS[4], "linestyle": (0, (4, 2))},
)


def calibration_sheet(
    images: UInt8[Tensor, "n 3 h w"],
    aspect: Float[Tensor, "n"],
    truth: CameraParameters,
    predicted: CameraParameters,
    *,
    method: str = "predicted",
    family: K2Family = "lopez",
) -> Figure:
    """Crops, four per row, drawn at their own aspect even if the pixels were squashed.

    The horizon is drawn as its distorted curve, and is missing if it lies outside the image.

    Args:
        images: bytes.
        aspect: width over height of each image.
        truth: the true cameras.
        predicted: a method's cameras; nan where it gave none.
        method: its label.
        family: how k2 follows from k1.

    Example:
        >>> truth = CameraParameters(*torch.tensor([[0.2], [0.0], [0.6], [-0.1]]))
        >>> images, aspect = torch.zeros(1, 3, 24, 32, dtype=torch.uint8), torch.tensor([4 / 3])
        >>> figure = calibration_sheet(images, aspect, truth, truth._replace(tilt=torch.zeros(1)))
        >>> print(figure.axes[0].get_xlabel().splitlines()[1])
        tilt   +11.5°     +0.0°
    """
    columns = min(COLUMNS, len(images))
    rows = -(-len(images) // columns)
    tallest = min(WIDTH / float(aspect.min()), WIDTH)  # inches
    figure, cells = new_figure(WIDTH * columns, (tallest + TEXT) * rows + 0.3, rows=rows, columns=columns)
    numbers = [camera_quantities(truth), camera_quantities(predicted)]
    for cell in cells[len(images) :]:
        cell.axis("off")
    for i, (cell, image) in enumerate(zip(cells, images, strict=False)):
        half = aspect[i].item() / 2
        cell.imshow(image.permute(1, 2, 0).cpu().numpy(), extent=(-half, half, 0.5, -0.5))
        for camera, style in zip((truth, predicted), STYLES, strict=True):
            tilt, roll, focal, k1 = camera.at(i).to(dtype=torch.float64)
            u, v = horizon_curve(tilt, roll, focal, k1, k2_of_k1(k1, family), points=POINTS).T
            outline = [Stroke(linewidth=3.2, foreground="black"), Normal()]
            cell.plot(u, v, linewidth=1.8, path_effects=outline, **style)
        cell.set_anchor("N")
        cell.set(xlim=(-half, half), ylim=(0.5, -0.5), xticks=[], yticks=[])
        true, found = ({name: values[i] for name, values in of.items()} for of in numbers)
        lines = [f"{'':6}{'true':>7} {method[:9]:>9}"]
        lines += [f"{title:<6}{form.format(true[name]):>7} {_said(form, found[name]):>9}" for title, name, form in ROWS]
        cell.set_xlabel("\n".join(lines), family="monospace", fontsize=7.5)
    handles = [Line2D([], [], linewidth=1.8, label=f"horizon: {name}", **style)
               for name, style in zip(("true", method), STYLES, strict=True)]  # fmt: skip
    figure.legend(handles=handles, loc="outside upper center", ncols=2, frameon=False, fontsize=9)
    return figure


def _said(form: str, value: float) -> str:
    return form.format(value) if math.isfinite(value) else "–"
