r"""Poses of recorded drives in the files of EuRoC, RobotCar and NCLT, with their times.

============ ======================================================================================================
``euroc``    ``state_groundtruth_estimate0/data.csv``: ``#timestamp [ns], p_RS_R_x [m], ..., q_RS_w [], ...``; the
             body's z axis points ahead (M. Burri et al., "The EuRoC micro aerial vehicle datasets", IJRR 2016); also
             the ``mocap0/data.csv`` of TUM VI
``robotcar`` ``ins.csv`` or ``rtk.csv``: ``timestamp`` (microseconds), ``northing, easting, down, roll, pitch, yaw``;
             or ``vo.csv``: the pose of the source frame in the earlier destination frame (W. Maddern et al., "1 year,
             1000 km: The Oxford RobotCar dataset", IJRR 2017)
``nclt``     ``groundtruth_<date>.csv`` or ``odometry_mu_100hz.csv``, without a header: microseconds, x, y, z, roll,
             pitch, yaw (N. Carlevaris-Bianco et al., "University of Michigan North Campus long-term vision and lidar
             dataset", IJRR 2016)
============ ======================================================================================================

RobotCar and NCLT state poses north, east, down of a body x ahead, y right, z down, with the rotation
:math:`R_z(yaw) R_y(pitch) R_x(roll)`. Here they become east, north, up of a body x ahead, y left, z up:
``plane=xy ahead=x``.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial.transform import Rotation

from sextant.chapters.localization.data.pose_formats import LENGTH_TOLERANCE, pose_matrices
from sextant.chapters.localization.data.pose_times import SECOND, epoch_ns
from sextant.data.positions import FURTHEST
from sextant.errors import UserError, problem_list
from sextant.tables import counted
from sextant.user_files import TextTable, check_columns, read_table

Recorded = Literal["euroc", "robotcar", "nclt"]
RECORDED: tuple[Recorded, ...] = ("euroc", "robotcar", "nclt")
POSED = ("p_rs_r_x", "p_rs_r_y", "p_rs_r_z", "q_rs_w", "q_rs_x", "q_rs_y", "q_rs_z")
NAVIGATED = ("northing", "easting", "down", "roll", "pitch", "yaw")
MOVED = ("x", "y", "z", "roll", "pitch", "yaw")
#: columns of a time (the second only in vo.csv), and nanoseconds of its unit
TIMES: dict[Recorded, tuple[tuple[str, ...], int]] = {
    "euroc": (("timestamp",), 1),
    "robotcar": (("timestamp", "source_timestamp", "destination_timestamp"), 1000),
    "nclt": (("utime",), 1000),
}
LAYOUT: dict[Recorded, str] = {
    "euroc": "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []",
    "robotcar": f"timestamp, {', '.join(NAVIGATED)} (ins.csv, rtk.csv); or source_timestamp, destination_timestamp, "
    f"{', '.join(MOVED)} (vo.csv)",
    "nclt": "no header, and 7 numbers a line: microseconds, x, y, z, roll, pitch, yaw",
}
#: axes of a body x ahead, y right, z down in one with y left, z up; and north, east, down in east, north, up
BODY = np.diag([1.0, -1.0, -1.0])
WORLD = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])


def recorded_format(header: Sequence[str]) -> Recorded | None:
    """The format whose columns, or first numbers, a table has.

    Example:
        >>> recorded_format(["source_timestamp", "destination_timestamp", "x", "y", "z", "roll", "pitch", "yaw"])
        'robotcar'
    """
    names = set(_plain(header))
    if {"timestamp", *POSED} <= names:
        return "euroc"
    if {"timestamp", *NAVIGATED} <= names or {"source_timestamp", "destination_timestamp", *MOVED} <= names:
        return "robotcar"
    return "nclt" if len(header) == 7 and epoch_ns(header[0]) is not None else None


def _plain(header: Sequence[str]) -> list[str]:
    return [name.partition("[")[0].strip().lower() for name in header]  # without units


def read_recorded(
    path: Path | str, form: Recorded | None = None
) -> tuple[Float64[ndarray, "n"], Float64[ndarray, "n 4 4"]]:
    """Read seconds, and ``world_from_body`` with z of the world up. Rows of NCLT without a pose (``NaN``) are left out.

    Args:
        path: the file.
        form: its format; None if any is expected.

    Raises:
        UserError: it has another layout, a column is there twice, a number is missing, a quaternion is not a rotation,
            or times do not increase; the message names the line.
    """
    path = Path(path)
    table = read_table(path)
    found = recorded_format(table.header)
    if found is None or form not in (None, found):
        layout = LAYOUT[form] if form else "; or ".join(LAYOUT.values())
        held = f"is in the layout of {found}" if found else f"begins with {', '.join(table.header[:8]) or 'nothing'}"
        expected = f"in that of {form}" if form else "a file of poses"
        raise UserError(f"{path} {held}, not {expected}", f"Columns: {layout}")
    header, rows = _plain(table.header), table.rows
    if found == "nclt":
        header, rows = ["utime", *MOVED], [(1, list(table.header)), *rows]
    chained = "source_timestamp" in header
    wanted = POSED if found == "euroc" else NAVIGATED if "northing" in header else MOVED
    names, unit = TIMES[found]
    check_columns(str(path), header, (*wanted, *names))
    values = _numbers(table, rows, [header.index(name) for name in wanted], found)
    stamps = [_stamps(path, rows, header.index(name), name) for name in names if name in header]
    if found == "nclt":
        known = np.isfinite(values).all(axis=1)
        values, stamps, rows = values[known], [stamps[0][known]], [row for row, k in zip(rows, known, strict=True) if k]
    if not rows:
        raise UserError(f"{path} has no poses", f"Columns: {LAYOUT[found]}")
    _check(path, rows, values, stamps, euroc=found == "euroc")
    times = stamps[0] * unit / SECOND
    if found == "euroc":
        return times, pose_matrices(values[:, :3], values[:, [4, 5, 6, 3]])
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("ZYX", values[:, [5, 4, 3]]).as_matrix()
    poses[:, :3, 3] = values[:, :3]
    if chained:
        times = np.concatenate([stamps[1][:1] * unit / SECOND, times])
        poses = _chained(poses)
    poses[:, :3, :3] = WORLD @ poses[:, :3, :3] @ BODY
    poses[:, :3, 3] = poses[:, :3, 3] @ WORLD.T
    return times, poses


def _chained(steps: Float64[ndarray, "n 4 4"]) -> Float64[ndarray, "m 4 4"]:
    """Poses from the pose of each frame in the one before."""
    poses = [np.eye(4)]
    for step in steps:
        poses.append(poses[-1] @ step)
    return np.stack(poses)


def _numbers(
    table: TextTable, rows: list[tuple[int, list[str]]], columns: list[int], form: Recorded
) -> Float64[ndarray, "n k"]:
    """Columns as numbers; in NCLT's files they may be nan."""
    try:
        values = np.array([[row[column] for column in columns] for _, row in rows], np.float64)
    except (IndexError, ValueError):
        values = np.empty((0, 0))
    if len(values) != len(rows) or not (np.isfinite(values) | (form == "nclt")).all():
        for line, row in rows:
            cells = [row[column] if column < len(row) else "" for column in columns]
            if any(table.number(cell) is None and not (form == "nclt" and cell.lower() == "nan") for cell in cells):
                raise UserError(
                    f"{table.path}: line {line} is not a pose: {','.join(row[:8])}", f"Columns: {LAYOUT[form]}"
                )
    return values


def _stamps(path: Path, rows: list[tuple[int, list[str]]], column: int, name: str) -> ndarray:
    """Whole numbers of a column, exactly."""
    found = []
    for line, row in rows:
        if not row[column].isdecimal():
            raise UserError(f"{path}: line {line}: {name}={row[column]!r} is not a time", "A whole number.")
        found.append(int(row[column]))
    return np.array(found, np.int64)


def _check(
    path: Path, rows: list[tuple[int, list[str]]], values: ndarray, stamps: list[ndarray], *, euroc: bool
) -> None:
    """Raise a ``UserError`` that names lines whose pose or time cannot be used."""
    found = {
        f"the position is further away than {FURTHEST:g}": (np.abs(values[:, :3]) > FURTHEST).any(axis=1),
        "its time is not after that of the line before": np.diff(stamps[0], prepend=stamps[0][0] - 1) <= 0,
    }
    if euroc:
        lengths = np.linalg.norm(values[:, 3:7], axis=1)
        found["the quaternion has not length 1"] = np.abs(lengths - 1) > LENGTH_TOLERANCE
    if len(stamps) > 1:
        source, destination = stamps
        found["source_timestamp is not after destination_timestamp"] = source <= destination
        jumps = np.append(False, destination[1:] != source[:-1])
        found["destination_timestamp is not the source_timestamp of the line before"] = jumps
    problems = [f"line {rows[k][0]}: {what}" for what, bad in found.items() for k in np.flatnonzero(bad).tolist()]
    if problems:
        raise UserError(f"{path}: {counted(len(problems), 'line')} cannot be used\n{problem_list(problems)}")
