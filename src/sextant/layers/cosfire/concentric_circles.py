r"""Parts on circles around the point of interest: the original way to configure COSFIRE filters.

On a circle of radius ρ, the largest response of all channels is a function of the direction φ. At each of its peaks,
channels with at least ``t2`` of the strongest response become parts; likewise at the centre.

Source: G. Azzopardi, N. Petkov, "Trainable COSFIRE filters for keypoint detection and pattern recognition", PAMI 35,
2013, section 2.3.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from sextant.layers.cosfire.strategy import Strategy
from sextant.layers.cosfire.tuples import Tuples


@dataclass(frozen=True)
class ConcentricCircles(Strategy):
    """Strategy C: peaks of the responses on concentric circles.

    >>> maps = torch.zeros(1, 21, 21)
    >>> maps[0, 10, 10:] = 1.0  # a line from the point to the right
    >>> parts = ConcentricCircles(radii=(0.0, 4.0)).tuples(maps, grid=torch.tensor([[0.0]]), point=(10, 10))
    >>> parts.rho.tolist(), parts.phi.rad2deg().round().tolist()  # directions 1° to 360°
    ([0.0, 4.0], [0.0, 360.0])

    Args:
        radii: ρ of the circles, in pixels of the maps; 0 is the centre.
        t2: a channel is kept if it reaches this share of the strongest response.
        relative_to: the strongest response at the same place (``place``, the paper) or in the whole example
            (``example``).
        apart_deg: least angle between peaks of a circle; the stronger is kept.
        one_of: keep only the strongest of the channels that agree in all numbers but the first (wavelength of Gabor
            filters, σ of differences of Gaussians); does nothing for channels of one number.

    Raises:
        ValueError: no radius, a negative one, or t2 outside [0, 1].
    """

    radii: tuple[float, ...] = (0.0, 3.0, 8.0)
    t2: float = 0.75
    relative_to: Literal["place", "example"] = "place"
    apart_deg: float = 22.5
    one_of: bool = True

    def __post_init__(self) -> None:
        if not self.radii or min(self.radii) < 0 or not 0 <= self.t2 <= 1:
            raise ValueError(f"circles need radii >= 0 and t2 in [0, 1]; got {self.radii} and {self.t2}")

    def tuples(self, maps: Float[Tensor, "k y x"], grid: Float[Tensor, "k p"], point: tuple[int, int]) -> Tuples:
        """Parts on the circles; see :meth:`Strategy.tuples`. Outside the maps, responses are 0."""
        responses = maps.detach().double().cpu().numpy()
        strongest = responses.max() if self.relative_to == "example" else None
        channels, rho, phi = [], [], []
        for radius in self.radii:
            degrees = np.arange(1, 361) if radius else np.zeros(1)
            seen = _on_circle(responses, point, radius, np.radians(degrees))
            for direction in _circular_peaks(seen.max(0), self.apart_deg) if radius else [0]:
                for channel in self._chosen(seen[:, direction], strongest, grid):
                    channels.append(channel)
                    rho.append(float(radius))
                    phi.append(math.radians(degrees[direction]))
        return Tuples(grid[channels].double(), torch.tensor(rho).double(), torch.tensor(phi).double())

    def _chosen(self, here: ndarray, strongest: float | None, grid: Tensor) -> list[int]:
        """The channels that are strong enough at one place."""
        least = self.t2 * (here.max() if strongest is None else strongest)
        enough = np.flatnonzero((here > 0) & (here >= least)).tolist()
        if not self.one_of or grid.shape[1] == 1:
            return enough
        best: dict[tuple[float, ...], int] = {}
        for k in enough:
            kind = tuple(grid[k, 1:].tolist())
            if kind not in best or here[k] > here[best[kind]]:
                best[kind] = k
        return sorted(best.values())


def _on_circle(responses: ndarray, point: tuple[int, int], radius: float, angles: ndarray) -> ndarray:
    """Responses (k, angles) at the pixels of a circle; 0 outside."""
    rows = point[0] - _rounded(radius * np.sin(angles))
    columns = point[1] + _rounded(radius * np.cos(angles))
    height, width = responses.shape[1:]
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    return np.where(inside, responses[:, rows.clip(0, height - 1), columns.clip(0, width - 1)], 0.0)


def _rounded(values: ndarray) -> ndarray:
    near = np.round(values, 4)
    return np.copysign(np.floor(np.abs(near) + 0.5), near).astype(np.int64)


def _circular_peaks(circle: ndarray, apart: float) -> list[int]:
    """Peaks of a closed sequence, at the middle of each plateau and at least ``apart`` apart; the stronger is kept."""
    from scipy.signal import find_peaks  # takes two seconds to import

    lowest = int(circle.argmin())
    opened = np.roll(circle, -lowest)  # begins at a minimum, so that no plateau is cut
    found = find_peaks(np.append(opened, opened[0]))[0]
    kept: list[int] = []
    for index in sorted(found.tolist(), key=lambda i: (-opened[i], i)):
        if all(min(abs(index - k), len(circle) - abs(index - k)) >= apart for k in kept):
            kept.append(index)
    return sorted((index + lowest) % len(circle) for index in kept)
