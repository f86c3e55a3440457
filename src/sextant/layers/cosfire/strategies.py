"""Strategies: how the parts of a COSFIRE filter are found in the maps of one example."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import torch
import torch.nn.functional as F
from annotated_types import Ge, Le, MinLen
from jaxtyping import Bool, Float, Int64
from numpy import ndarray
from torch import Tensor

from sextant.layers.cosfire.tuples import Tuples
from sextant.ranges import Count, NonNegative, Positive, checked


class Strategy(ABC):
    """Finds the parts of a filter."""

    @abstractmethod
    def tuples(self, maps: Float[Tensor, "k y x"], grid: Float[Tensor, "k p"], point: tuple[int, int]) -> Tuples:
        """The parts around ``point`` (row and column of the maps); none where there is no structure.

        Args:
            maps: the bank's description of the example, non-negative.
            grid: the channel of each map.
        """


def peaks(strength: Float[Tensor, "k y x"], window: int = 1) -> Bool[Tensor, "k y x"]:
    """Where a map is positive and the maximum of a square of side ``2 window + 1``.

    A plateau that fills its square is not a peak. With a window of 0 every positive pixel is one.
    """
    if window == 0:
        return strength > 0
    side = 2 * window + 1
    largest = F.max_pool2d(strength[None], side, 1, window)[0]
    lowest = -F.max_pool2d(-strength[None], side, 1, window)[0]
    return (strength > 0) & (strength == largest) & (largest > lowest)


def near(maps: Float[Tensor, "k y x"], point: tuple[int, int], reach: float) -> Bool[Tensor, "y x"]:
    """Which pixels of the maps lie within ``reach`` of the point (row, column)."""
    rows, columns = (torch.arange(size, device=maps.device) for size in maps.shape[1:])
    return (rows[:, None] - point[0]) ** 2 + (columns[None, :] - point[1]) ** 2 <= reach**2


def keep_apart(
    strength: Float[Tensor, "n"], y: Int64[Tensor, "n"], x: Int64[Tensor, "n"], apart: float, most: int
) -> list[int]:
    """Indices of the strongest, at most ``most``, whose places coincide or are at least ``apart`` apart."""
    kept: list[int] = []
    for index in torch.argsort(strength, descending=True, stable=True).tolist():
        squared = [int((y[index] - y[k]) ** 2 + (x[index] - x[k]) ** 2) for k in kept]
        if all(distance == 0 or distance >= apart**2 for distance in squared):
            kept.append(index)
        if len(kept) == most:
            break
    return kept


@checked
@dataclass(frozen=True)
class ConcentricCircles(Strategy):
    """Strategy C: peaks of the responses on concentric circles.

    On a circle of radius ρ, the largest response of all channels is a function of the direction φ. At each of its
    peaks, channels with at least ``t2`` of the strongest response become parts; likewise at the centre.

    Source: G. Azzopardi, N. Petkov, "Trainable COSFIRE filters for keypoint detection and pattern recognition", PAMI
    35, 2013, section 2.3.

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
        ArgumentError: no radius, a negative one, or t2 outside [0, 1].
    """

    radii: Annotated[tuple[NonNegative, ...], MinLen(1)] = (0.0, 3.0, 8.0)
    t2: Annotated[float, Ge(0), Le(1)] = 0.75
    relative_to: Literal["place", "example"] = "place"
    apart_deg: NonNegative = 22.5
    one_of: bool = True

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


@dataclass(frozen=True)
class MapKeypoints(Strategy):
    """Parts at keypoints of maps; determines the places, not the channels.

    Args:
        window: a keypoint is the maximum of a square of 2 window + 1 pixels of its map; 0: any pixel strong enough.
        reach: parts lie within this many pixels of the point.
        strength: keypoints have at least this share of the example's strongest.
        apart: least distance between the places of parts, in pixels; several parts may share a place.
        most: largest number of parts; the strongest are kept.

    Raises:
        ArgumentError: ``strength`` is outside [0, 1], ``window`` is negative, or ``most`` is below 1.
    """

    window: Annotated[int, Ge(0), Le(1000)] = 1
    reach: Positive = 8.0
    strength: Annotated[float, Ge(0), Le(1)] = 0.2
    apart: NonNegative = 1.0
    most: Count = 20

    def strongest(
        self, strength: Float[Tensor, "k y x"], among: Bool[Tensor, "k y x"] | None, point: tuple[int, int]
    ) -> tuple[Int64[Tensor, "n"], Int64[Tensor, "n"], Int64[Tensor, "n"]]:
        """Map, row and column of the keypoints around ``point``, strongest first; ``among`` None allows any pixel."""
        found = peaks(strength, self.window) & near(strength, point, self.reach)
        found &= strength >= self.strength * strength.max()
        k, y, x = (found if among is None else found & among).nonzero(as_tuple=True)
        kept = torch.tensor(keep_apart(strength[k, y, x], y, x, self.apart, self.most), dtype=torch.int64)
        return k[kept], y[kept], x[kept]


@checked
@dataclass(frozen=True)
class ChannelPeaks(MapKeypoints):
    """Strategy A: local maxima of each channel.

    The paper says that contributing filters are defined by intermediate representations of a network. In this reading,
    its channels take the role of the Gabor filters in the first COSFIRE.

    >>> import torch
    >>> maps = torch.zeros(2, 9, 9)
    >>> maps[0, 2, 6] = maps[1, 2, 4] = 1.0  # up to the right of the point, and above it
    >>> parts = ChannelPeaks().tuples(maps, grid=torch.tensor([[0.0], [1.0]]), point=(4, 4))
    >>> parts.channels[:, 0].tolist(), parts.rho.round(decimals=2).tolist(), parts.phi.rad2deg().round().tolist()
    ([0.0, 1.0], [2.83, 2.0], [45.0, 90.0])

    Args:
        t2: a channel is kept if it reaches this share of the strongest channel at its place.
        other arguments: as for :class:`MapKeypoints`.

    Raises:
        ArgumentError: as for :class:`MapKeypoints`, or ``t2`` is outside [0, 1].
    """

    t2: Annotated[float, Ge(0), Le(1)] = 0.75

    def tuples(self, maps: Float[Tensor, "k y x"], grid: Float[Tensor, "k p"], point: tuple[int, int]) -> Tuples:
        """Parts at peaks; see :meth:`Strategy.tuples`."""
        k, y, x = (found.cpu() for found in self.strongest(maps, maps >= self.t2 * maps.amax(0), point))
        return Tuples.at(grid[k], x - point[1], y - point[0])


@checked
@dataclass(frozen=True)
class VectorKeypoints(MapKeypoints):
    """Strategy B: local maxima of the length of feature vectors; for a :class:`VectorBank`.

    Each part is a 1x1 filter: the direction of the example's feature vector at a place where that vector is long. It
    responds where features have the same direction.

    >>> import torch
    >>> maps = torch.zeros(2, 9, 9)
    >>> maps[:, 4, 7] = torch.tensor([3.0, 4.0])
    >>> parts = VectorKeypoints().tuples(maps, grid=torch.eye(2), point=(4, 4))
    >>> parts.channels, parts.rho  # a vector of length 1, three pixels off
    (tensor([[0.6000, 0.8000]], dtype=torch.float64), tensor([3.], dtype=torch.float64))

    Args:
        arguments: as for :class:`MapKeypoints`.

    Raises:
        ArgumentError: as for :class:`MapKeypoints`.
    """

    def tuples(self, maps: Float[Tensor, "k y x"], grid: Float[Tensor, "k p"], point: tuple[int, int]) -> Tuples:
        """Parts at keypoints, their channels vectors of length 1; see :meth:`Strategy.tuples`."""
        length = maps.norm(dim=0)
        _, y, x = self.strongest(length[None], None, point)
        vectors = (maps[:, y, x] / length[y, x]).T.cpu()
        return Tuples.at(vectors, x.cpu() - point[1], y.cpu() - point[0])
