"""Crops with their true and predicted horizons, and the numbers beneath."""

import math
from typing import Any

import torch
from jaxtyping import Float, UInt8
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import Normal, Stroke
from torch import Tensor

from sextant.figures.calibration.errors import camera_quantities
from sextant.figures.calibration.horizon import horizon_curve
from sextant.figures.style import COLOURS, new_figure
from sextant.geometry import CameraParameters, K2Family, k2_of_k1

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

    The horizon is drawn as the curve that the lens makes of it; it is missing if it lies outside the image.

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
