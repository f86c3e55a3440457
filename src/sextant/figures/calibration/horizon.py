"""The horizon as seen by a camera, for drawing."""

import math

import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from sextant.geometry import perspective_project, rotation_from_tilt_roll


def horizon_curve(
    tilt: Float[Tensor, ""],
    roll: Float[Tensor, ""],
    focal: Float[Tensor, ""],
    k1: Float[Tensor, ""],
    k2: Float[Tensor, ""],
    *,
    reach: float = math.inf,
    points: int = 4001,
) -> Float[ndarray, "p 2"]:
    """Points of one camera's horizon in image heights from the centre, left to right; nan where it is not seen.

    It accepts any camera, even one whose lens folds inside the image, which a camera object would reject.

    Args:
        tilt: radians, positive upward.
        roll: radians.
        focal: image heights.
        k1: first coefficient of distortion.
        k2: second coefficient.
        reach: points further than this from the centre are nan too: they would only be clipped.
        points: number of points, at even azimuths in front of the camera.

    Example:
        >>> none, focal = torch.tensor(0.0), torch.tensor(1.0)
        >>> horizon_curve(none, none, focal, none, none, points=3).round(3)  # a level camera's is a level line
        array([[-1.,  0.],
               [ 0.,  0.],
               [ 1.,  0.]])
    """
    azimuths = torch.linspace(-math.pi / 2, math.pi / 2, points + 2, dtype=torch.float64)[1:-1]
    level = torch.stack([torch.sin(azimuths), torch.zeros_like(azimuths), torch.cos(azimuths)], -1)
    tilt, roll, focal, k1, k2 = (value.detach().double().cpu() for value in (tilt, roll, focal, k1, k2))
    curve, visible = perspective_project(level @ rotation_from_tilt_roll(tilt, roll), focal, k1, k2)
    near = torch.linalg.vector_norm(curve, dim=-1) < reach
    return torch.where((visible & near)[:, None], curve, torch.nan).numpy()
