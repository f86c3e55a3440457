r"""Parts on circles about the point of interest: how COSFIRE filters have been configured from the beginning.

On a circle of radius ρ the largest response of all channels is looked at as a function of the direction φ. At each of
its peaks, channels with at least ``t2`` of the strongest become parts; at the centre likewise.

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
from scipy.signal import find_peaks
from torch import Tensor

from sextant.layers.cosfire.strategy import Strategy
from sextant.layers.cosfire.tuples import Tuples


@dataclass(frozen=True)
class ConcentricCircles(Strategy):
    """Strategy C.

    Args:
        radii: ρ of the circles, in pixels of the maps; 0 is the centre.
        t2: a channel is kept from this share of the strongest on.
        relative_to: which strongest: of the place (``place``, the paper) or of the whole example (``example``).
        apart_deg: peaks of a circle are at least so far apart; the stronger stays.
        one_of: channels that agree in all but their first number (Gabor: the wavelength) count as rivals, of which
            the strongest is kept; no such choice if False.

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
        """Parts on the circles; see :meth:`Strategy.tuples`. Outside the maps there is nothing."""
        responses = maps.detach().double().cpu().numpy()
        channels, rho, phi = [], [], []
        for radius in self.radii:
            for degrees in [0] if radius == 0 else self._directions(responses, radius, point):
                for channel in self._chosen(_at(responses, *_on_circle(point, radius, degrees)), responses, grid):
                    channels.append(channel)
                    rho.append(float(radius))
                    phi.append(math.radians(degrees))
        return Tuples(grid[channels].double(), torch.tensor(rho).double(), torch.tensor(phi).double())

    def _directions(self, responses: ndarray, radius: float, point: tuple[int, int]) -> list[int]:
        """Degrees of the peaks of one circle, 1 to 360."""
        circle = np.array([_at(responses, *_on_circle(point, radius, degrees)).max() for degrees in range(1, 361)])
        if circle.min() == circle.max():
            return []
        return [index + 1 for index in _circular_peaks(circle, self.apart_deg)]

    def _chosen(self, here: ndarray, responses: ndarray, grid: Tensor) -> list[int]:
        strongest = here.max() if self.relative_to == "place" else responses.max()
        if strongest <= 0:
            return []
        enough = [k for k in range(len(here)) if here[k] > 0 and here[k] >= self.t2 * strongest]
        if not self.one_of:
            return enough
        best: dict[tuple[float, ...], int] = {}
        for k in enough:
            kind = tuple(grid[k, 1:].tolist())
            if kind not in best or here[k] > here[best[kind]]:
                best[kind] = k
        return sorted(best.values())


def _on_circle(point: tuple[int, int], radius: float, degrees: float) -> tuple[int, int]:
    angle = math.radians(degrees)
    return _rounded(point[0] - radius * math.sin(angle)), _rounded(point[1] + radius * math.cos(angle))


def _rounded(value: float) -> int:
    value = round(value, 4)
    return int(math.copysign(math.floor(abs(value) + 0.5), value))


def _at(responses: ndarray, row: int, column: int) -> ndarray:
    if 0 <= row < responses.shape[1] and 0 <= column < responses.shape[2]:
        return np.asarray(responses[:, row, column])
    return np.zeros(len(responses))


def _circular_peaks(circle: ndarray, apart: float) -> list[int]:
    """Peaks of a closed sequence, the middle of each plateau, at least ``apart`` apart; the stronger stays."""
    lowest = int(circle.argmin())
    opened = np.roll(circle, -lowest)  # begins at a minimum, so that no plateau is cut
    found = find_peaks(np.append(opened, opened[0]))[0]
    kept: list[int] = []
    for index in sorted(found.tolist(), key=lambda i: (-opened[i], i)):
        if all(min(abs(index - k), len(circle) - abs(index - k)) >= apart for k in kept):
            kept.append(index)
    return sorted((index + lowest) % len(circle) for index in kept)
