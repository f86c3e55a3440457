"""Objects that stand in a town, and whether a camera is in their way."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray
from scipy.spatial import cKDTree


@dataclass(frozen=True)
class Objects:
    """Objects that stand in a town, one row each: x, y, z, heading, seed in [0, 1)."""

    rows: Float64[ndarray, "n 5"]

    @classmethod
    def of(cls, rows: list[tuple[float, float, float, float, float]]) -> "Objects":
        """From a list of tuples."""
        return cls(np.array(rows, float).reshape(-1, 5))

    @property
    def position(self) -> Float64[ndarray, "n 3"]:
        """Metres."""
        return self.rows[:, :3]

    @property
    def heading(self) -> Float64[ndarray, "n"]:
        """Radians."""
        return self.rows[:, 3]

    @property
    def seed(self) -> Float64[ndarray, "n"]:
        """In [0, 1)."""
        return self.rows[:, 4]

    def where(self, chosen: Bool[ndarray, "n"]) -> "Objects":
        """A selection of the objects."""
        return Objects(self.rows[chosen])


def clear_of_cameras(
    place: Float64[ndarray, "n 2"],
    heading: Float64[ndarray, "n"],
    cameras: Float64[ndarray, "c 2"] | None,
    reach: tuple[float, float],
) -> Bool[ndarray, "n"]:
    """Which objects have no camera within ``reach`` metres (along and across their heading) of their centre."""
    if cameras is None or not len(cameras) or not len(place):
        return np.ones(len(place), bool)
    far, near = cKDTree(cameras).query(place, k=min(16, len(cameras)), distance_upper_bound=float(np.hypot(*reach)))
    far, near = far.reshape(len(place), -1), near.reshape(len(place), -1)
    offset = np.where(np.isfinite(far)[..., None], cameras[np.minimum(near, len(cameras) - 1)] - place[:, None], np.inf)
    c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
    with np.errstate(invalid="ignore"):
        along, across = np.abs(c * offset[..., 0] + s * offset[..., 1]), np.abs(c * offset[..., 1] - s * offset[..., 0])
    return np.asarray(~((along < reach[0]) & (across < reach[1])).any(1))
