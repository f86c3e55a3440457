"""Poses in space as poses in a plane."""

from typing import Literal, get_args

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.errors import ArgumentError, problem_list

#: the two world axes that the robot moves along
Plane = Literal["xy", "xz", "yz"]
PLANES: tuple[Plane, ...] = get_args(Plane)
#: the axis of the posed body that points ahead: z for a camera, x for a robot
Ahead = Literal["x", "z"]
AHEAD: tuple[Ahead, ...] = get_args(Ahead)
#: an axis steeper than this to the plane has no meaningful heading
STEEPEST_DEG = 75.0


def to_plane(
    world_from_body: Float64[ndarray, "n 4 4"], plane: Plane, ahead: Ahead, what: str
) -> Float64[ndarray, "n 3"]:
    r"""Positions in a plane, and the heading of the axis that points ahead.

    With u, v the axes of the plane and :math:`a = R e` the body's axis in the world, the pose is
    :math:`(t_u, t_v, \operatorname{atan2}(a_v, a_u))`: turns from u to v are positive. Height, roll and tilt are
    discarded.

    Args:
        world_from_body: poses in space.
        plane: ``xy`` if z is up, ``xz`` if y is down (KITTI) or up.
        ahead: ``z`` for poses of a camera, ``x`` for poses of a robot.
        what: names the poses in messages.

    Raises:
        UserError: an axis is steeper than 75 degrees to the plane, so that its heading is not meaningful.
    """
    u, v = ("xyz".index(letter) for letter in plane)
    axis = world_from_body[:, :3, "xyz".index(ahead)]
    level = np.hypot(axis[:, u], axis[:, v])
    steep = np.degrees(np.arctan2(np.sqrt(np.maximum(0.0, 1 - level**2)), level))
    wrong = np.flatnonzero(steep > STEEPEST_DEG)
    if len(wrong):
        listed = problem_list([f"pose {i + 1}: {steep[i]:.0f} degrees" for i in wrong.tolist()])
        raise ArgumentError(
            f"{what}: the {ahead} axis of {len(wrong):,} of {len(axis):,} poses looks nearly perpendicular to the "
            f"plane {plane}, so its heading is unknown\n{listed}",
            "Name the plane that the camera moves in (plane=xz where y is down, as in KITTI; xy where z is "
            "up), and the axis\nof the poses that looks ahead (ahead=z for a camera, x for a robot).",
        )
    position = world_from_body[:, :3, 3]
    return np.column_stack([position[:, u], position[:, v], np.arctan2(axis[:, v], axis[:, u])])
