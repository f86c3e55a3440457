r"""Levelling: the photo that a level camera without distortion would have taken from the same place.

A pixel of the level picture at the normalised point p looks in the direction :math:`R^\top (p, 1)` of the camera, with
:math:`R = R_x(\theta) R_z(\psi)` of :func:`~sextant.geometry.rotation_from_tilt_roll`; its colour is that of the photo
where the lens shows that direction.
"""

import math

import numpy as np
import torch
from jaxtyping import UInt8
from numpy import ndarray

from sextant.geometry import perspective_project, rotation_from_tilt_roll

#: tilt (radians) beyond which a level picture would be grossly stretched
STEEPEST = math.radians(30)


def level_photo(
    image: UInt8[ndarray, "h w 3"], tilt: float, roll: float, focal: float, k1: float, k2: float
) -> tuple[UInt8[ndarray, "h w 4"], bool]:
    """Remove roll and distortion from a picture of the same size, and tilt up to :data:`STEEPEST`.

    Without tilt, vertical lines are vertical in the picture too. The photo's centre stays in the centre, as with a
    shift lens.

    Args:
        image: the photo.
        tilt: of its camera, radians, positive upward.
        roll: of its camera, radians.
        focal: its focal length in pixels of ``image``.
        k1: first coefficient of its distortion.
        k2: second coefficient.

    Returns:
        RGB and opacity, 0 where the photo shows nothing; and whether tilt was removed.
    """
    import cv2

    height, width = image.shape[:2]
    undone = abs(tilt) <= STEEPEST
    leant = tilt if undone else 0.0
    rotation = rotation_from_tilt_roll(*torch.tensor([leant, roll], dtype=torch.float64))
    straight = focal * math.cos(leant)  # same width as the photo, in its middle
    x = (torch.arange(width, dtype=torch.float64) + 0.5 - width / 2) / straight
    y = (torch.arange(height, dtype=torch.float64) + 0.5 - height / 2) / straight - math.tan(leant)
    down, across = torch.meshgrid(y, x, indexing="ij")
    lens = torch.tensor([focal, k1, k2], dtype=torch.float64)
    points, seen = perspective_project(
        torch.stack([across, down, torch.ones_like(x)[None].expand_as(down)], -1) @ rotation, *lens
    )
    points = torch.where(seen[..., None], points + torch.tensor([width, height]) / 2 - 0.5, -10)
    opaque = np.dstack([image, np.full((height, width), 255, np.uint8)])
    columns, rows = points.numpy().astype(np.float32).transpose(2, 0, 1)
    return cv2.remap(opaque, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT), undone
