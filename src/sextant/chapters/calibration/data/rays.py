r"""The rays of a batch of cameras as points in panoramas.

A camera with tilt θ and roll ψ that is turned by ``yaw`` to the right has the panorama-from-camera rotation
:math:`R_y(\mathrm{yaw}) R_x(θ) R_z(ψ)`: its centre is at longitude ``yaw`` and latitude θ. In a panorama rendered with
heading h, it is the view of a camera of heading h - yaw; headings are counter-clockwise.
"""

import threading
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from jaxtyping import Float, Float32, Int64
from numpy import ndarray
from torch import Tensor

from sextant.chapters.calibration.data.camera_distributions import CameraDraw
from sextant.compiled import compiled as machine_code
from sextant.geometry import K2Family, k2_of_k1, rotation_from_tilt_roll

ONE, HALF, ZERO = np.float32(1), np.float32(0.5), np.float32(0)
THREE, FIVE = np.float32(3), np.float32(5)
PI, HALF_PI, TURN = np.float32(np.pi), np.float32(np.pi / 2), np.float32(1 / (2 * np.pi))
HALF_TURN = np.float32(1 / np.pi)
TINY = np.float32(1e-30)
# atan(t) = t (A0 + A1 t^2 + ...) on [0, 1]
A0, A1, A2, A3 = map(np.float32, (0.9999993352449782, -0.33329859485023816, 0.19946551162679638, -0.1390855883019973))
A4, A5, A6, A7 = map(
    np.float32, (0.09642021022109792, -0.05590998143866008, 0.02186137333506314, -0.004054139885805612)
)


#: sums keep their order; values are finite
compiled = partial(machine_code, fastmath={"contract", "nnan", "ninf", "nsz"})


@compiled
def panorama_points(  # type: ignore[no-untyped-def]
    lens, rotation, steps, panorama_width, panorama_height, columns, rows, scratch, out_x, out_y
):
    """Points in a padded panorama, in pixels with the centre of the first at 0, onto which a camera's pixels map.

    Lengths are in focal lengths. A pixel at distorted radius :math:`r_d` has the undistorted radius r that solves
    :math:`r(1 + k_1 r^2 + k_2 r^4) = r_d`, found by Newton's method; its ray :math:`(x r/r_d, y r/r_d, 1)` is turned
    into the panorama's frame, where longitude is ``atan2(x, z)`` and latitude ``atan2(-y, hypot(x, z))``.

    Loops run over one row without branches, so that the compiler can vectorize them. The arctangent is a polynomial of
    eight terms with an error of 4e-8. Overall, positions in a panorama 8192 columns wide are accurate to 0.001 pixels.

    Args:
        lens: ``(4,)`` half width and half height of the image in focal lengths, k1, k2.
        rotation: ``(9,)`` panorama from camera, row by row.
        steps: steps of Newton's method.
        panorama_width: columns of the panorama without its border.
        panorama_height: rows of the panorama without its border.
        columns: ``(w,)`` positions of the columns' centres, from -1 (left) to 1.
        rows: ``(h,)`` positions of the rows' centres, from -1 (top) to 1.
        scratch: ``(3, w)``, overwritten.
        out_x: ``(h, w)`` columns, written.
        out_y: ``(h, w)`` rows, written.
    """
    width = len(columns)
    x, wanted, radius = scratch[0], scratch[1], scratch[2]
    half_width, half_height, k1, k2 = lens[0], lens[1], lens[2], lens[3]
    a, b, c = rotation[0], rotation[1], rotation[2]
    d, e, f = rotation[3], rotation[4], rotation[5]
    g, h, k = rotation[6], rotation[7], rotation[8]
    scale_x, scale_y = np.float32(panorama_width) * TURN, np.float32(panorama_height) * HALF_TURN
    middle_x, middle_y = np.float32(panorama_width) * HALF + HALF, np.float32(panorama_height) * HALF + HALF
    slope1, slope2 = THREE * k1, FIVE * k2
    for j in range(width):
        x[j] = columns[j] * half_width
    height = len(rows)
    for pair in range((height + 1) // 2):
        y = rows[pair] * half_height
        for j in range(width):
            r = np.sqrt(x[j] * x[j] + y * y)
            wanted[j] = r
            radius[j] = r
        for _ in range(steps):
            for j in range(width):
                r = radius[j]
                s = r * r
                excess = r * (ONE + s * (k1 + k2 * s)) - wanted[j]
                radius[j] = r - excess / (ONE + s * (slope1 + slope2 * s))
        for j in range(width):
            s = radius[j] * radius[j]
            radius[j] = ONE / (ONE + s * (k1 + k2 * s))  # undistorted by distorted radius from here on
        for side in range(2):  # the mirrored row below the middle has the same radii
            row, below = (pair, y) if side == 0 else (height - 1 - pair, -y)
            points_x, points_y = out_x[row], out_y[row]
            for j in range(width):
                u, v = x[j] * radius[j], below * radius[j]
                right, down, ahead = a * u + b * v + c, d * u + e * v + f, g * u + h * v + k
                level = np.sqrt(right * right + ahead * ahead)
                # longitude
                across, along = abs(right), abs(ahead)
                steep = across > along
                low, high = (along, across) if steep else (across, along)
                t = low / (high + TINY)
                q = t * t
                angle = t * (A0 + q * (A1 + q * (A2 + q * (A3 + q * (A4 + q * (A5 + q * (A6 + q * A7)))))))
                angle = HALF_PI - angle if steep else angle
                angle = PI - angle if ahead < ZERO else angle
                angle = -angle if right < ZERO else angle
                points_x[j] = angle * scale_x + middle_x
                # latitude, positive downward
                across = abs(down)
                steep = across > level
                low, high = (level, across) if steep else (across, level)
                t = low / (high + TINY)
                q = t * t
                angle = t * (A0 + q * (A1 + q * (A2 + q * (A3 + q * (A4 + q * (A5 + q * (A6 + q * A7)))))))
                angle = HALF_PI - angle if steep else angle
                angle = -angle if down < ZERO else angle
                points_y[j] = angle * scale_y + middle_y


@compiled
def mean_of_rays(picture, side, sums, out):  # type: ignore[no-untyped-def]
    """The mean of each block of ``side`` by ``side`` pixels, rounded, channels first.

    Args:
        picture: ``(side h, side w, 4)`` bytes.
        side: 1 to 8.
        sums: ``(4 side w,)`` of uint16, overwritten.
        out: ``(3, h, w)`` bytes, written.
    """
    height, width = out.shape[1], out.shape[2]
    wide = 4 * side * width
    area = side * side
    factor, half = np.int32(65536 // area + 1), np.int32(area // 2)  # exact for sums of up to 64 bytes
    for row in range(height):
        first = picture[side * row].reshape(wide)
        for j in range(wide):
            sums[j] = first[j]
        for k in range(1, side):
            other = picture[side * row + k].reshape(wide)
            for j in range(wide):
                sums[j] += other[j]
        for channel in range(3):
            plane = out[channel, row]
            for j in range(width):
                total = half
                for k in range(side):
                    total += np.int32(sums[4 * (side * j + k) + channel])
                plane[j] = np.uint8((total * factor) >> 16)


#: relative size of a Newton step below which single precision is reached
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
    """The quantities that determine the rays of cameras.

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
        """Columns and rows, in a padded panorama, onto which the pixels of an image taken by camera ``i`` map.

        The panorama's size is that without its border; the centre of the border's first pixel is (0, 0).
        The arrays are overwritten by the next call with the same size in the same thread.
        """
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
