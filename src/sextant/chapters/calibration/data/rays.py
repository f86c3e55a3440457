r"""The rays of a batch of cameras as points in panoramas.

A camera with tilt θ and roll ψ that is turned by ``yaw`` to the right has the panorama-from-camera rotation
:math:`R_y(\mathrm{yaw}) R_x(θ) R_z(ψ)`: its centre sees longitude ``yaw`` and latitude θ. A panorama rendered with
heading h shows what a camera of heading h - yaw sees, headings being counter-clockwise.
"""

import threading
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32, Int64
from numpy import ndarray
from torch import Tensor

from sextant.chapters.calibration.data.camera_distributions import CameraDraw
from sextant.geometry import K2Family, k2_of_k1, rotation_from_tilt_roll

#: after a Newton step smaller than this share of the radius, single precision is reached
SMALL = 1e-6
MOST_STEPS = 40
#: radii, from the centre to the corner, at which convergence is checked
PROBES = np.linspace(1 / 16, 1, 16)


def rotation_about_vertical(yaw: Float[Tensor, "*b"]) -> Float[Tensor, "*b 3 3"]:
    """The rotation to the right by ``yaw``, in a frame with x right, y down, z forward."""
    c, s, zero = torch.cos(yaw), torch.sin(yaw), torch.zeros_like(yaw)
    return torch.stack([c, zero, s, zero, zero + 1, zero, -s, zero, c], dim=-1).reshape(*yaw.shape, 3, 3)


def centres(count: int) -> Float32[ndarray, "count"]:
    """Centres of pixels that fill the interval from -1 to 1."""
    return ((2 * np.arange(count) + 1) / count - 1).astype(np.float32)


@dataclass(frozen=True)
class Rays:
    """The quantities that the rays of cameras depend on.

    Attributes:
        lens: half width and half height of the image in focal lengths, k1, k2.
        rotation: panorama from camera, row by row.
        steps: Newton steps that undistortion takes.
    """

    lens: Float32[ndarray, "b 4"]
    rotation: Float32[ndarray, "b 9"]
    steps: Int64[ndarray, "b"]

    @classmethod
    def of(cls, draw: CameraDraw, family: K2Family) -> "Rays":
        """The rays of drawn cameras of a lens family."""
        tilt, roll, focal, k1 = (value.detach().to("cpu", torch.float64) for value in draw.cameras)
        yaw, aspect = (value.detach().to("cpu", torch.float64) for value in (draw.yaw, draw.aspect))
        rotation = rotation_about_vertical(yaw) @ rotation_from_tilt_roll(tilt, roll)
        lens = torch.stack([0.5 * aspect / focal, 0.5 / focal, k1, k2_of_k1(k1, family)], -1).numpy()
        return cls(lens.astype(np.float32), rotation.reshape(-1, 9).numpy().astype(np.float32), newton_steps(lens))

    def points(
        self, i: int, panorama_width: int, panorama_height: int, width: int, height: int
    ) -> tuple[Float32[ndarray, "height width"], Float32[ndarray, "height width"]]:
        """Columns and rows, in a padded panorama, that the pixels of an image taken by camera ``i`` see.

        The panorama's size is that without its border; the centre of the border's first pixel is (0, 0).
        The arrays are overwritten by the next call with the same size in the same thread.
        """
        from sextant.chapters.calibration.data.ray_kernels import panorama_points

        columns, rows, scratch, x, y = _buffers(width, height)
        panorama_points(
            self.lens[i], self.rotation[i], self.steps[i], float(panorama_width), float(panorama_height),
            columns, rows, scratch, x, y,
        )  # fmt: skip
        return x, y


_kept = threading.local()


def _buffers(width: int, height: int) -> tuple[ndarray, ...]:
    """Positions of columns and rows, scratch rows, and arrays for the points; those of the last size are kept."""
    if getattr(_kept, "size", None) != (width, height):
        _kept.size = width, height
        x, y = np.empty((2, height, width), np.float32)
        _kept.buffers = centres(width), centres(height), np.empty((3, width), np.float32), x, y
    return _kept.buffers  # type: ignore[no-any-return]


def newton_steps(lens: Float[ndarray, "b 4"]) -> Int64[ndarray, "b"]:
    """Newton steps, starting from the distorted radius, until every pixel's undistorted radius has converged.

    From this start it converges on the whole rising branch: from below where the polynomial is concave, from above
    where it is convex.
    """
    wanted = np.hypot(lens[:, 0], lens[:, 1]) * PROBES[:, None]
    k1, k2 = lens[:, 2], lens[:, 3]
    radius = wanted.copy()
    steps = np.zeros(len(lens), np.int64)
    for _ in range(MOST_STEPS):
        square = radius * radius
        slope = 1 + square * (3 * k1 + 5 * k2 * square)
        step = (radius * (1 + square * (k1 + k2 * square)) - wanted) / slope
        moving = (np.abs(step) > SMALL * radius).any(axis=0)
        if not moving.any():
            break
        steps += moving
        radius -= step
    return steps
