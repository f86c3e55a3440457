"""Trajectories in the TUM format: one line per pose, ``timestamp tx ty tz qx qy qz qw``.

Seconds, metres, and a unit quaternion whose scalar part comes last; lines that start with # are comments. Source:
J. Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012, and its page of file formats.
"""

from io import BytesIO
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial.transform import Rotation

from sextant.atomic_files import write_atomically
from sextant.data.positions import too_far
from sextant.errors import ArgumentError, UserError, problem_list
from sextant.tables import counted
from sextant.user_files import read_lines
from sextant.worlds.trajectories import load_kitti_poses

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
            f"{what}: the {ahead} axis of {len(wrong):,} of {counted(len(axis), 'pose')} is nearly perpendicular to "
            f"the plane {plane}, so its heading is unknown\n{listed}",
            "Name the plane that the camera moves in (plane=xz where y is down, as in KITTI; xy where z is "
            "up), and the axis\nof the poses that points ahead (ahead=z for a camera, x for a robot).",
        )
    position = world_from_body[:, :3, 3]
    return np.column_stack([position[:, u], position[:, v], np.arctan2(axis[:, v], axis[:, u])])


#: quaternions in files are rounded: their norm may differ from 1 by this
LENGTH_TOLERANCE = 1e-2


def read_tum(path: Path | str) -> tuple[Float64[ndarray, "n"], Float64[ndarray, "n 3"]]:
    """Read seconds, and poses in the plane z = 0 with the heading of the body's x axis; see :func:`write_tum`.

    Raises:
        UserError: see :func:`read_tum_matrices`; or the x axis points straight up or down.
    """
    times, poses = read_tum_matrices(path)
    return times, to_plane(poses, "xy", "x", str(path))


def write_tum(path: Path | str, times_s: Float64[ndarray, "n"], poses: Float64[ndarray, "n 3"]) -> None:
    """Write poses in the plane (x, y in metres, heading in rad) at full precision, as poses in space with z = 0.

    Raises:
        ValueError: the lengths differ.
    """
    if len(times_s) != len(poses):
        raise ValueError(f"{len(times_s)} times for {len(poses)} poses")
    x, y, heading = np.asarray(poses, np.float64).T
    zero = np.zeros(len(poses))
    table = np.column_stack([times_s, x, y, zero, zero, zero, np.sin(heading / 2), np.cos(heading / 2)])
    lines = ["# timestamp tx ty tz qx qy qz qw", *(" ".join(repr(value) for value in row) for row in table.tolist())]
    text = BytesIO(("\n".join(lines) + "\n").encode())
    write_atomically(Path(path), lambda file: file.write(text.getvalue()))


def read_tum_matrices(path: Path | str) -> tuple[Float64[ndarray, "n"], Float64[ndarray, "n 4 4"]]:
    """Read seconds and ``world_from_body``.

    Raises:
        UserError: the file does not exist or has no poses, a line does not have 8 finite numbers, a quaternion is not a
            rotation, a position is implausibly far away, or times do not increase; the message names the file and the
            lines.
    """
    rows: list[list[float]] = []
    numbers: list[int] = []
    problems: list[str] = []
    for number, words in read_lines(path, "A file of lines: timestamp tx ty tz qx qy qz qw"):
        row = _floats(words)
        if len(words) != 8 or row is None:
            problems.append(f"line {number}: 8 finite numbers are expected, got {' '.join(words[:4])} ...")
        elif abs(np.linalg.norm(row[4:]) - 1) > LENGTH_TOLERANCE:
            problems.append(f"line {number}: the quaternion has length {np.linalg.norm(row[4:]):.3g}, not 1")
        elif far := too_far(row[1:4]):
            problems.append(f"line {number}: {far}")
        elif rows and row[0] <= rows[-1][0]:
            problems.append(f"line {number}: time {row[0]:.6f} is not after {rows[-1][0]:.6f} of line {numbers[-1]}")
        else:
            rows.append(row)
            numbers.append(number)
    if problems or not rows:
        raise UserError(
            f"{path}: {counted(len(problems), 'line') + ' cannot be used' if problems else 'it has no poses'}\n"
            f"{problem_list(problems)}".rstrip(),
            "Each line: timestamp tx ty tz qx qy qz qw, in order of time.",
        )
    table = np.array(rows)
    return np.ascontiguousarray(table[:, 0]), pose_matrices(table[:, 1:4], table[:, 4:])


def read_kitti(path: Path | str) -> Float64[ndarray, "n 4 4"]:
    """Read ``world_from_body`` from a KITTI file; see :func:`~sextant.worlds.trajectories.load_kitti_poses`.

    Raises:
        UserError: as there, or a position is implausibly far away; the message names the line.
    """
    poses = load_kitti_poses(path)
    for (number, _), position in zip(read_lines(path), poses[:, :3, 3].tolist(), strict=True):
        if far := too_far(position):
            raise UserError(f"{path}, line {number}: {far}", "Correct this line.")
    return poses


def _floats(words: list[str]) -> list[float] | None:
    try:
        row = [float(word) for word in words]
    except ValueError:
        return None
    return row if np.isfinite(row).all() else None


def pose_matrices(position: Float64[ndarray, "n 3"], quaternion: Float64[ndarray, "n 4"]) -> Float64[ndarray, "n 4 4"]:
    """Pose matrices from positions and quaternions (x, y, z, w) of any non-zero norm."""
    poses = np.tile(np.eye(4), (len(position), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(quaternion).as_matrix()
    poses[:, :3, 3] = position
    return poses
