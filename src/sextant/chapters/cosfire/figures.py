"""Pictures of COSFIRE filters and of their detections."""

import math
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Integer, UInt8
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle
from matplotlib.transforms import Affine2D
from numpy import ndarray
from torch import Tensor

from sextant.figures.gallery import gallery
from sextant.figures.style import COLOURS, new_figure, printable
from sextant.layers.cosfire import Cosfire, DoGBank, GaborBank
from sextant.layers.cosfire.tuples import offsets

#: circles drawn individually; of more than this, only the outermost is drawn
MOST_CIRCLES = 12
#: most kinds of parts that the legend names
MOST_NAMES = 7
#: length of a bar in wavelengths: the envelope of a Gabor filter of the usual shape, one sigma to either side
BAR_LENGTH = 1.25
FAINTEST, STRONGEST = 0.3, 0.9
#: share of that opacity for discs with bars on top
BELOW_BARS = 0.5
#: radii about the point that are shown of an example much larger than the filter
AROUND = 1.6


def cosfire_filter(
    filters: Cosfire,
    example: Float[Tensor, "c h w"],
    point: tuple[float, float] | None = None,
    *,
    number: int = 0,
    title: str = "",
) -> Figure:
    """The parts of one filter at their places in its prototype.

    A disc has the size of the part's tolerance σ = σ0 + αρ, and is more opaque the more the part weighs. For Gabor
    filters, the part's feature is shown as a bar of half a wavelength in its direction; otherwise the colour shows the
    channel.

    Args:
        filters: configured filters; the parts are those of ``filters.tuples(number)``.
        example: as given to ``configure``, in [0, 1].
        point: likewise, x and y in its pixels; None is the pixel in the middle.
        number: of the filter.
        title: title above the figure.

    Raises:
        ValueError: the bank does not accept images with this number of channels.

    Example:
        >>> image = torch.ones(1, 48, 48)
        >>> image[:, 23:26, 24:] = 0  # a dark bar that ends in the middle
        >>> filters = Cosfire(GaborBank((6.0,))).configure(image)
        >>> cosfire_filter(filters, image).axes[0].get_title()
        '21 parts'
    """
    height, width = example.shape[1:]
    x, y = point or (width // 2, height // 2)
    stride = _stride(filters, example)
    parts, weights = filters.tuples(number), _weights(filters, number)
    across, down = (part.detach().double().numpy() for part in offsets(parts.rho, parts.phi))
    rho, channels = parts.rho.detach().numpy(), parts.channels.detach().numpy()
    names = _names(filters, channels)
    kinds = list(dict.fromkeys(names))
    sigmas = np.maximum(stride * (filters.blur.sigma0 + filters.blur.alpha * rho), 0.4)
    left, right, top, bottom = _seen((x, y), AROUND * float((stride * rho + sigmas).max()), (width, height))
    wide, high = right - left, bottom - top
    figure, (axes,) = new_figure(5.0 * min(1.0, wide / high) + 1.6, 5.0 * min(1.0, high / wide) + 0.6)
    picture = example.detach().float().clamp(0, 1).permute(1, 2, 0).numpy()
    axes.imshow(picture[..., 0] if picture.shape[2] == 1 else picture[..., :3], cmap="gray", vmin=0, vmax=1)
    _circles(axes, (x, y), stride * np.unique(rho.round(6)))
    bars = isinstance(filters.bank, GaborBank)
    for part, kind in enumerate(names):
        centre = (x + stride * across[part], y + stride * down[part])
        colour = COLOURS[kinds.index(kind) % len(COLOURS)]
        opacity = FAINTEST + (STRONGEST - FAINTEST) * weights[part] / max(weights.max(), 1e-12)
        opacity *= BELOW_BARS if bars else 1.0
        disc = Circle(centre, float(sigmas[part]), facecolor=colour, edgecolor="white", linewidth=0.5, alpha=opacity)
        axes.add_patch(disc)
        if bars:
            axes.add_patch(_bar(axes, centre, channels[part], colour, opacity / BELOW_BARS))
    axes.plot(x, y, "+", color="white", markersize=11, markeredgewidth=2.4)
    axes.plot(x, y, "+", color="black", markersize=9, markeredgewidth=1.2)
    axes.set(xticks=[], yticks=[], xlim=(left, right), ylim=(bottom, top))
    axes.set_title(title or f"{len(names)} parts", fontsize=9)
    if 0 < len(kinds) <= MOST_NAMES:
        handles: list[Artist] = [
            Line2D([], [], marker="o", linestyle="", color=COLOURS[i % len(COLOURS)], label=kind)
            for i, kind in enumerate(kinds)
        ]
        figure.legend(handles=handles, loc="outside right upper", frameon=False, fontsize=8)
    return figure


def _seen(point: tuple[float, float], reach: float, size: tuple[int, int]) -> tuple[float, float, float, float]:
    """Left, right, top and bottom of the part shown: within ``reach`` of the point and within the example."""
    (x, y), (width, height) = point, size
    left, right = max(-0.5, x - reach), min(width - 0.5, x + reach)
    return left, right, max(-0.5, y - reach), min(height - 0.5, y + reach)


def _stride(filters: Cosfire, example: Tensor) -> float:
    """Image pixels per pixel of the maps."""
    with torch.no_grad():
        return float(example.shape[-1] / filters.bank.describe(example[None]).shape[-1])


def _weights(filters: Cosfire, number: int) -> Float[ndarray, "n"]:
    first = int((filters.filter_of_form == number).nonzero()[0, 0])
    return filters.weights.detach().double().numpy()[(filters.form == first).numpy()]  # type: ignore[no-any-return]


def _names(filters: Cosfire, channels: Float[ndarray, "n p"]) -> Sequence[str]:
    """The kind of each part."""
    if isinstance(filters.bank, GaborBank):
        return [f"λ {wavelength:.3g} px" for wavelength, _ in channels]
    if isinstance(filters.bank, DoGBank):
        return [f"{'bright' if polarity > 0 else 'dark'}, σ {sigma:.3g} px" for sigma, polarity in channels]
    if channels.shape[1] == 1:
        return [f"channel {int(channel)}" for (channel,) in channels]
    return [f"vector {part + 1}" for part in range(len(channels))]


def _circles(axes: Axes, centre: tuple[float, float], radii: Float[ndarray, "r"]) -> None:
    """The circles that parts lie on, or one around all of them if there are too many."""
    radii = radii[radii > 0]
    for radius in radii if len(radii) <= MOST_CIRCLES else radii[-1:]:
        for colour, line in (("black", 1.6), ("white", 0.8)):
            axes.add_patch(Circle(centre, float(radius), fill=False, edgecolor=colour, linewidth=line, alpha=0.6))


def _bar(
    axes: Axes, centre: tuple[float, float], channel: Float[ndarray, "2"], colour: str, opacity: float
) -> Rectangle:
    """A bar half a wavelength wide; θ is the direction across it, counter-clockwise, with y downward."""
    wavelength, theta = channel
    width, length = wavelength / 2, BAR_LENGTH * wavelength
    corner = (centre[0] - width / 2, centre[1] - length / 2)
    bar = Rectangle(corner, width, length, facecolor=colour, edgecolor="white", linewidth=0.6, alpha=opacity)
    bar.set_transform(Affine2D().rotate_deg_around(*centre, -math.degrees(theta)) + axes.transData)
    return bar


#: most keypoints with their score beside them
MOST_SCORES = 25
#: opacity of the strongest response
OPAQUE = 0.85


def cosfire_responses(
    image: UInt8[ndarray, "h w *c"],
    response: Float[ndarray, "y x"],
    points: Sequence[tuple[float, float, float]] = (),
    *,
    strongest: float | None = None,
    title: str = "",
) -> Figure:
    """Image, response and keypoints side by side.

    Args:
        image: grey ``(h, w)`` or ``(h, w, 1)``, or RGB; bytes.
        response: over the image, of any size: its cells cover the image.
        points: x and y in pixels of the image, and the score of each.
        strongest: the response at the top of the colour scale; None for the largest one in ``response``.
        title: above the figure.

    Example:
        >>> response = np.zeros((16, 16))
        >>> response[4, 8] = 0.9
        >>> figure = cosfire_responses(np.zeros((32, 32), np.uint8), response, [(16.5, 8.5, 0.9)])
        >>> [axes.get_title() for axes in figure.axes[:3]], figure.axes[2].texts[0].get_text()
        (['image', 'response', '1 found'], '0.90')
    """
    picture = image[..., 0] if image.ndim == 3 and image.shape[2] == 1 else image
    height, width = picture.shape[:2]
    top = float(response.max()) if strongest is None else strongest
    figure, axes = new_figure(3 * 3.2 + 0.6, 3.2 * height / width + 0.6, columns=3)
    for cell in axes:
        cell.imshow(picture, cmap="gray", vmin=0, vmax=255)
    share = np.clip(response / top if top > 0 else np.zeros_like(response), 0, 1)
    drawn = axes[1].imshow(
        response,
        cmap="inferno",
        vmin=0,
        vmax=top if top > 0 else 1,
        alpha=OPAQUE * np.sqrt(share),  # so that weak responses are visible too
        extent=(-0.5, width - 0.5, height - 0.5, -0.5),
        interpolation="nearest",
    )
    figure.colorbar(drawn, ax=axes[1], shrink=0.7, pad=0.02).ax.tick_params(labelsize=7)
    for number, (x, y, score) in enumerate(points):
        axes[2].plot(x, y, "o", markersize=9, markerfacecolor="none", markeredgecolor="black", markeredgewidth=2.6)
        axes[2].plot(x, y, "o", markersize=9, markerfacecolor="none", markeredgecolor=COLOURS[4], markeredgewidth=1.5)
        if number < MOST_SCORES:
            axes[2].annotate(
                f"{score:.2f}",
                (x, y),
                xytext=(6, 4),
                textcoords="offset points",
                fontsize=7,
                color="white",
                bbox={"boxstyle": "round,pad=0.15", "facecolor": "black", "alpha": 0.6, "linewidth": 0},
            )
    names = ("image", "response", f"{len(points)} found")
    for cell, name in zip(axes, names, strict=True):
        cell.set(xticks=[], yticks=[], xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
        cell.set_title(name, fontsize=8)
    if title:
        figure.suptitle(printable(title), fontsize=9)
    return figure


#: images on the sheet
MOST = 40


def recognition_errors(
    images: UInt8[ndarray, "n c h w"],
    labels: Integer[ndarray, "n"],
    answers: Integer[ndarray, "n"],
    classes: Sequence[str],
    *,
    title: str = "",
) -> Figure | None:
    """Misclassified test images, with ``truth → answer`` above each; None if there are none.

    If there are more than :data:`MOST` errors, evenly spaced ones are shown, so that no class is left out because of
    its position.

    Args:
        images: test images, bytes.
        labels: true classes.
        answers: classes predicted by the method.
        classes: names in label order.
        title: such as the name of the method; the number of errors is added.

    Example:
        >>> images, labels, answers = np.zeros((4, 1, 8, 8), np.uint8), np.array([0, 0, 1, 1]), np.array([0, 1, 1, 1])
        >>> figure = recognition_errors(images, labels, answers, ["cat", "dog"], title="svm")
        >>> figure.get_suptitle(), figure.axes[0].get_title()
        ('svm: 1 of 4 wrong (25.00 %)', 'cat → dog')
    """
    wrong = np.flatnonzero(labels != answers)
    if not len(wrong):
        return None
    shown = wrong[np.linspace(0, len(wrong) - 1, min(MOST, len(wrong))).round().astype(int)]
    pictures = [images[i, 0] if images.shape[1] == 1 else images[i].transpose(1, 2, 0) for i in shown]
    figure = gallery(pictures, [f"{classes[int(labels[i])]} → {classes[int(answers[i])]}" for i in shown])
    told = f"{len(wrong):,} of {len(labels):,} wrong ({100 * len(wrong) / len(labels):.2f} %)"
    told += f", {len(shown)} shown" if len(shown) < len(wrong) else ""
    figure.suptitle(f"{title}: {told}" if title else told, fontsize=9)
    return figure
