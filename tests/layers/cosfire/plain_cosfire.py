"""COSFIRE written out in numpy, one part after the other and nothing shared: what the layer must equal."""

import math

import numpy as np
from layers.convolution_cases import NUMPY_BORDER
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import map_coordinates
from scipy.stats import trim_mean


def correlated(image, kernel, border):
    reach = len(kernel) // 2
    windows = sliding_window_view(np.pad(image, reach, mode=NUMPY_BORDER[border]), kernel.shape)
    return np.einsum("yxij,ij->yx", windows, kernel)


def gabor(image, channel, *, phase, border, bandwidth=2.0, aspect=0.5):
    wavelength, theta = channel
    sigma = wavelength / np.pi * np.sqrt(np.log(2) / 2) * (2**bandwidth + 1) / (2**bandwidth - 1)
    reach = math.ceil(2.5 * sigma / aspect)
    rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    x, y = columns, -rows
    across, along = x * np.cos(theta) + y * np.sin(theta), y * np.cos(theta) - x * np.sin(theta)
    kernel = np.exp(-(across**2 + aspect**2 * along**2) / (2 * sigma**2))
    kernel = kernel * np.cos(2 * np.pi * across / wavelength + phase)
    kernel = np.where(kernel > 0, kernel / kernel[kernel > 0].sum(), kernel / -kernel[kernel < 0].sum())
    return np.maximum(0, correlated(image, kernel, border))


def gaussian(sigma, reach):
    rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    weights = np.exp(-(rows**2 + columns**2) / (2 * sigma**2))
    return weights / weights.sum()


def dog(image, channel, *, ratio, border):
    sigma, polarity = channel
    reach = math.ceil(3 * sigma)
    kernel = gaussian(ratio * sigma, reach) - gaussian(sigma, reach)
    return np.maximum(0, polarity * correlated(image, kernel, border))


def half_up(value):
    return math.floor(value + 0.5)


def blurred(image, sigma, blur):
    if sigma == 0:
        return image
    if blur.kind == "sum":
        length = half_up(2 * blur.reach * sigma)
        reach = (length + 1 - length % 2) // 2
        return correlated(image, gaussian(sigma, reach if blur.fixed_reach is None else blur.fixed_reach), blur.border)
    reach = half_up(blur.reach * sigma) if blur.fixed_reach is None else blur.fixed_reach
    rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    weights = np.exp(-(rows**2 + columns**2) / (2 * sigma**2))
    return (sliding_window_view(np.pad(image, reach), weights.shape) * weights).max((2, 3))


def seen(image, rho, phi, *, shift, border, fill):
    """The image at the place of a part, from each of its pixels."""
    dx, dy = rho * np.cos(phi), -rho * np.sin(phi)
    if shift == "whole":
        dx, dy = (np.sign(v) * half_up(abs(round(v, 4))) for v in (dx, dy))
    margin = math.ceil(rho) + 2
    filled = {"constant_values": fill} if border == "zeros" else {}
    wide = np.pad(image, margin, mode=NUMPY_BORDER[border], **filled)
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    return map_coordinates(wide, [rows + margin + dy, columns + margin + dx], order=1)


def averaged(parts, weights, mean):
    with np.errstate(divide="ignore"):
        return {
            "geometric": lambda: np.prod(parts ** weights[:, None, None], 0),
            "arithmetic": lambda: np.average(parts, axis=0, weights=weights),
            "harmonic": lambda: 1 / (weights[:, None, None] / parts).sum(0),
            "trimmed": lambda: trim_mean(parts, 0.2),
            "median": lambda: np.median(parts, 0),
        }[mean]()


def plain_response(image, maps, strongest, parts, moved, moves, options):
    """Responses of one filter.

    ``maps(image, channel)`` is a map of the bank, ``strongest`` the most in the grid's maps, ``parts`` tuples (channel,
    rho, phi), ``moved(channel, move)`` another channel, and ``options`` the layer whose numbers are taken.
    """
    forms = []
    for move in moves:
        looked_at, weights = [], []
        for channel, rho, phi in parts:
            map_ = maps(image, moved(channel, move))
            map_ = np.where(map_ < options.t1 * strongest, 0, map_)
            here = rho * move.scale
            map_ = np.maximum(
                blurred(map_, options.blur.sigma0 + options.blur.alpha * here, options.blur), options.floor
            )
            there = (np.pi - phi if move.mirrored else phi) + move.rotation_rad
            view = {"shift": options.shift, "border": options.border, "fill": options.floor}
            looked_at.append(seen(map_, here, there, **view))
            weights.append(options.least_weight ** ((rho / max(max(part[1] for part in parts), 1e-9)) ** 2))
        weights = np.array(weights) / np.sum(weights)
        forms.append(averaged(np.stack(looked_at), weights, options.mean))
    response = np.max(forms, 0)
    return np.where(response < options.t3 * response.max(), 0, response)
