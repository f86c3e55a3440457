"""Rotations, scales and reflections of its prototype that a filter responds to as well."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple


class Move(NamedTuple):
    """How an image is moved about a point: mirrored left to right, then turned, then enlarged."""

    rotation_rad: float  # counter-clockwise as seen
    scale: float
    mirrored: bool

    @property
    def nothing(self) -> bool:
        """Whether it leaves everything in place."""
        return self.rotation_rad == 0 and self.scale == 1 and not self.mirrored


@dataclass(frozen=True)
class Tolerance:
    """The moves of a prototype over which the strongest response counts.

    >>> [(round(move.rotation_rad, 2), move.scale) for move in Tolerance(rotations=2, scales=(0.5, 1.0)).moves()]
    [(0.0, 1.0), (0.0, 0.5), (3.14, 1.0), (3.14, 0.5)]

    Args:
        rotations: number of rotations, evenly spaced over ``span_deg`` from 0.
        span_deg: 360, or 180 for what looks the same upside down.
        scales: scale factors.
        reflection: whether the mirror image counts as well.

    Raises:
        ValueError: no rotation, no scale, or a scale that is not positive.
    """

    rotations: int = 1
    span_deg: float = 360.0
    scales: tuple[float, ...] = (1.0,)
    reflection: bool = False

    def __post_init__(self) -> None:
        if self.rotations < 1 or not self.scales or min(self.scales) <= 0:
            raise ValueError(
                f"tolerance needs at least one rotation and positive scales; got {self.rotations} and {self.scales}"
            )

    def moves(self) -> Iterator[Move]:
        """All combinations; the identity comes first if it is among them."""
        turns = [math.radians(self.span_deg * turn / self.rotations) for turn in range(self.rotations)]
        scales = [float(scale) for scale in sorted(self.scales, key=lambda scale: scale != 1)]
        for mirrored in (False, True)[: 1 + self.reflection]:
            for turn in turns:
                for scale in scales:
                    yield Move(turn, scale, mirrored)
