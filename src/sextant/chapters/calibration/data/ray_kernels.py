r"""Where the rays of a camera meet a panorama, and means of rays, as machine code.

Lengths are in focal lengths. A pixel at distorted radius :math:`r_d` has the undistorted radius r that solves
:math:`r(1 + k_1 r^2 + k_2 r^4) = r_d`, found by Newton's method; its ray :math:`(x r/r_d, y r/r_d, 1)` is turned into
the panorama's frame, where longitude is ``atan2(x, z)`` and latitude ``atan2(-y, hypot(x, z))``.

Loops run over one row and have no branches, so that the compiler works on many pixels at a time. The arctangent is a
polynomial of eight terms, fitted here to an error of 4e-8. Overall, a pixel's place in a panorama 8192 columns wide is
accurate to 0.001 pixels.
"""

from functools import partial

import numpy as np

from sextant.compiled import compiled as machine_code

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
    """Points in a padded panorama, in pixels with the centre of the first at 0, that the pixels of a camera look at.

    Args:
        lens: ``(4,)`` half width and half height of the image in focal lengths, k1, k2.
        rotation: ``(9,)`` panorama from camera, row by row.
        steps: of Newton's method.
        panorama_width: columns of the panorama without its border.
        panorama_height: rows of it.
        columns: ``(w,)`` places from -1 (left) to 1 of the columns' centres.
        rows: ``(h,)`` of the rows' centres.
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
        for side in range(2):  # the row as far below the middle as the first is above: the same radii
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
