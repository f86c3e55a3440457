r"""Pictures of any shape in the middle of a square, whose side is the picture's longer one.

One network can thus process portrait and landscape pictures, with square pixels and without cropping. A camera is *on
the canvas* when its focal length is in sides of the square: for a picture of aspect a, width over height,
:math:`f_\text{canvas} = f / \max(a, 1)`, and its nominal vertical field of view is that of the picture's longer side.
Tilt, roll and k1 are the same.
"""

import math

from jaxtyping import Float
from torch import Tensor

from sextant.geometry.parameterization import CameraParameters


def on_canvas(camera: CameraParameters, aspect: Float[Tensor, "*b"]) -> CameraParameters:
    """Convert cameras of pictures to cameras of their squares."""
    return camera._replace(focal=camera.focal / aspect.clamp(min=1))


def of_picture(camera: CameraParameters, aspect: Float[Tensor, "*b"]) -> CameraParameters:
    """Convert cameras of squares to cameras of the pictures in them."""
    return camera._replace(focal=camera.focal * aspect.clamp(min=1))


def picture_size(side: int, aspect: float) -> tuple[int, int]:
    """Columns and rows of a picture in a square of ``side`` pixels, an even number.

    Both are even, so that the picture's centre is the square's; the shorter side is rounded down, so that every pixel
    lies within the picture. But float32(4 / 3), which is above 4 / 3, gives 112 x 82.

    >>> picture_size(112, 4 / 3), picture_size(112, 9 / 16)
    ((112, 84), (62, 112))
    """
    columns, rows = side * min(aspect, 1.0), side / max(aspect, 1.0)
    return 2 * math.floor(columns / 2 + 1e-6), 2 * math.floor(rows / 2 + 1e-6)
