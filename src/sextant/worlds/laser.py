"""A planar laser scanner."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from sextant.errors import UserError


@runtime_checkable
class RayCaster(Protocol):
    """Anything that rays can be cast at."""

    def distance(
        self, origins: Float[ndarray, "n 3"], directions: Float[ndarray, "n 3"]
    ) -> Float[ndarray, " n"]:  # fmt: skip
        """Distance in metres from each origin along its direction to the first surface; inf where there is none."""
        ...


@dataclass(frozen=True)
class LaserScanner:
    """A scanner that turns in a horizontal plane.

    A beam at distance r measures ``r + N(0, range_sigma_m²)``, clipped to [0, max_range_m]. A beam that hits nothing
    within ``max_range_m``, and each beam with probability ``dropout``, returns exactly ``max_range_m``: no return.

    Attributes:
        beams: number of beams in a scan.
        field_of_view_rad: beams are spread evenly from half of it right of the heading to half of it left, both ends
            included; of a full turn the end is left out, because it coincides with the start.
        max_range_m: maximum range.
        height_m: height of the plane above z = 0.
        range_sigma_m: standard deviation of a range.
        dropout: probability of no return, in [0, 1].

    Raises:
        UserError: a value is out of range.

    Example:
        >>> np.degrees(LaserScanner(beams=5).angles)  # half a turn, from right to left
        array([-90., -45.,   0.,  45.,  90.])
    """

    beams: int = 180
    field_of_view_rad: float = float(np.pi)
    max_range_m: float = 30.0
    height_m: float = 0.3
    range_sigma_m: float = 0.01
    dropout: float = 0.0

    def __post_init__(self) -> None:
        for key, low, high in (
            ("beams", 1, 100_000),
            ("field_of_view_rad", 0.0, 2 * np.pi),
            ("max_range_m", 1e-3, 1e5),
            ("height_m", -1e3, 1e3),
            ("range_sigma_m", 0.0, 1e3),
            ("dropout", 0.0, 1.0),
        ):
            value = getattr(self, key)
            if not low <= value <= high:
                raise UserError(
                    f"{key}={value:g} is out of range: it must be in [{low:g}, {high:g}]",
                    f"Try {key}={getattr(LaserScanner, key):g}",
                )

    @property
    def angles(self) -> Float[ndarray, " beams"]:
        """Angle of each beam from the heading in radians, counter-clockwise."""
        full = self.field_of_view_rad >= 2 * np.pi * (1 - 1e-12)
        if self.beams == 1:
            return np.zeros(1)
        half = self.field_of_view_rad / 2
        return np.linspace(-half, half, self.beams, endpoint=not full)

    def exact(self) -> "LaserScanner":
        """The same scanner without noise and dropout."""
        return LaserScanner(self.beams, self.field_of_view_rad, self.max_range_m, self.height_m, 0.0, 0.0)


def scan(
    scanner: LaserScanner, caster: RayCaster, poses: Float[ndarray, "n 3"], rng: np.random.Generator
) -> Float[ndarray, "n beams"]:
    """Ranges in metres from each pose (x, y in metres, heading in radians); see `LaserScanner`.

    >>> class Wall:  # at x = 2
    ...     def distance(self, origins, directions):
    ...         return np.where(directions[:, 0] > 1e-9, (2 - origins[:, 0]) / directions[:, 0].clip(1e-9), np.inf)
    >>> ahead = LaserScanner(beams=3, max_range_m=10.0).exact()  # to the right, ahead and to the left
    >>> scan(ahead, Wall(), np.array([[0.0, 0.0, np.pi / 3]]), np.random.default_rng(0)).round(2)
    array([[ 2.31,  4.  , 10.  ]])
    """
    bearing = poses[:, 2:] + scanner.angles  # (n, beams)
    directions = np.stack([np.cos(bearing), np.sin(bearing), np.zeros_like(bearing)], axis=-1).reshape(-1, 3)
    eyes = np.column_stack([poses[:, :2], np.full(len(poses), scanner.height_m)])
    ranges = caster.distance(np.repeat(eyes, scanner.beams, axis=0), directions).reshape(bearing.shape)
    lost = (ranges >= scanner.max_range_m) | (rng.uniform(size=ranges.shape) < scanner.dropout)
    noisy = np.where(lost, 0.0, ranges) + scanner.range_sigma_m * rng.normal(size=ranges.shape)
    return np.where(lost, scanner.max_range_m, np.clip(noisy, 0.0, scanner.max_range_m))
