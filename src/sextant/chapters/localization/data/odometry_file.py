"""Odometry of the user's own images: a trajectory of TUM, EuRoC, RobotCar (``vo.csv``) or NCLT, or a table.

A table has the columns ``x,y,theta`` (metres, rad) or ``x,y,heading_deg``, and a row for each image in order; or with
``file`` a row for the named image; or with a time (``t``, ``time``, ``timestamp``, ``stamp``, ``sec`` with ``nsec``,
with a unit as in ``time_ms`` or ``timestamp [ns]``) poses that are interpolated at the times of the images.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import TypeVar

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.chapters.localization.data.drive import between
from sextant.chapters.localization.data.pose_formats import read_tum, to_plane
from sextant.chapters.localization.data.pose_times import EPOCH_UNITS, SAME_S, SECOND, interpolated, no_times
from sextant.chapters.localization.data.recorded_poses import read_recorded, recorded_format
from sextant.data.positions import FURTHEST
from sextant.errors import UserError
from sextant.tables import counted
from sextant.user_files import TextTable, check_columns, read_table, table_header

T = TypeVar("T")

#: widest gap in seconds over which poses are interpolated
GAP_S = 5.0
#: share of images with poses below which times of a much longer span are assumed to have another unit
FEW = 0.5
FIX = (
    "A table with commas: columns x,y,theta (metres, rad) or x,y,heading_deg, one row per image; or TUM: timestamp tx "
    "ty tz qx qy qz qw."
)
#: columns of a time, without its unit, and of the fraction of a second beside one
TIME = re.compile(
    r"(?:t|time|times|timestamp|time_?stamp|stamp|secs?|seconds)(?:[_ ]*[\[(]?(s|secs?|ms|us|ns|nsecs?)[\])]?)?"
)
FRACTION = ("nsec", "nsecs", "nanosec", "nanoseconds", "nanosecs")
UNITS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}


@dataclass(frozen=True, eq=False)
class OdometryFile:
    """Poses in their own frame of reference; a row of nan is unknown.

    Attributes:
        poses: x, y, heading.
        times_s: increasing times in seconds, or None.
        names: the file of each row, if the table has them.
        remarks: remarks on the file for the user.
        timed_rows: the times are a column of a table.
    """

    poses: Float64[ndarray, "n 3"]
    times_s: Float64[ndarray, "n"] | None = None
    names: tuple[str, ...] | None = None
    remarks: tuple[str, ...] = ()
    timed_rows: bool = False


def read_odometry(path: Path | str) -> OdometryFile:
    """Read a recording's poses or a table if the first line that is not a comment has commas, otherwise TUM.

    Raises:
        UserError: it is neither; the message names the file and the line.
    """
    path = Path(path)
    table = _telling(read_table, path)
    if (form := recorded_format(table.header)) is not None:
        times, in_space = _telling(read_recorded, path)
        return OdometryFile(to_plane(in_space, "xy", "z" if form == "euroc" else "x", f"odometry={path}"), times)
    first = " ".join(table.header)
    if len(first.split()) == 8 and table.separator != ";" and (len(table.header) == 1 or table.separator == "\t"):
        times, poses = _telling(read_tum, path)
        return OdometryFile(poses, times)
    if len(table.header) == 1:
        raise UserError(f"odometry={path} is neither a table with commas nor TUM; it begins with {first[:40]!r}", FIX)
    return _of_table(table)


def is_odometry_table(path: Path) -> bool:
    """Whether a file is a table of odometry: with a heading, and without names of files."""
    header = table_header(path)
    return {"x", "y"} <= set(header) and bool({"theta", "heading_deg"} & set(header)) and "file" not in header


def is_timed(path: Path) -> bool:
    """Whether a file is a table of odometry with times."""
    return is_odometry_table(path) and any(TIME.fullmatch(name) for name in table_header(path))


def _telling(read: Callable[[Path], T], path: Path) -> T:
    try:
        return read(path)
    except UserError as error:
        raise UserError(f"odometry={error.problem}", FIX) from None


def motions_of(
    odometry: OdometryFile,
    names: Sequence[str],
    times_s: Float64[ndarray, "n"] | None,
    given: Path,
    every: int = 1,
    frames: int | None = None,
) -> tuple[list[Float64[ndarray, "3"] | None], list[str]]:
    """The motion to each image from the one before, None where it is unknown, and remarks for the user.

    If poses and images have times, poses are taken at those of the images; otherwise rows are images in order. The rows
    of a table are also images in order if there are equally many, at times that differ by a constant.

    Args:
        odometry: the poses to take motions from.
        names: of the images.
        times_s: of the images, or None.
        given: the file, for messages.
        every: video frames from one image to the next.
        frames: number of frames if the images are from a video; None otherwise.

    Raises:
        UserError: the numbers of rows and images differ, or no image is within the trajectory.
    """
    remarks, poses = list(odometry.remarks), odometry.poses
    at_images = None
    if times_s is not None and (frames is None or odometry.timed_rows):
        at_images = _at_images(odometry, names, times_s, given, remarks)
    if at_images is not None:
        poses = at_images
    elif frames is not None and len(poses) == frames:
        poses = poses[::every]
    if len(poses) != len(names):
        unused = odometry.times_s is not None and times_s is None
        why = f"; its times cannot be used: {no_times(names)}" if unused else ""
        raise UserError(
            f"odometry={given} has {counted(len(poses), 'row')} for {counted(len(names), 'image')}, {names[0]} to "
            f"{names[-1]}{why}",
            "One row per image, in order; or a trajectory in TUM's format and file names in seconds; or a table "
            "with a column file.",
        )
    if odometry.timed_rows and times_s is None:
        remarks.append("odometry: its times are not used, since images have none: rows are matched to images in order")
    if odometry.times_s is not None and times_s is None:
        wide = np.flatnonzero(np.diff(odometry.times_s) > GAP_S)
        if len(wide):
            at = int(wide[0]) + 1
            remarks.append(
                f"odometry: {len(wide):,} gaps in time above {GAP_S:g} s, the first, of "
                f"{odometry.times_s[at] - odometry.times_s[at - 1]:.1f} s, before {names[at]}"
            )
    unknown = int((~np.isfinite(poses).all(axis=1)).sum())
    if unknown and at_images is None:
        remarks.append(
            f"odometry: {unknown:,} of {counted(len(poses), 'row')} {'is' if unknown == 1 else 'are'} empty: motion "
            "to and from them is unknown"
        )
    moved = between(poses[:-1], poses[1:])
    far = np.nan_to_num(np.abs(moved).max(axis=1)) > FURTHEST
    if far.any():
        at = int(far.argmax())
        raise UserError(
            f"odometry={given} moves by {moved[at, 0]:.3g}, {moved[at, 1]:.3g} from {names[at]} to {names[at + 1]}",
            "Leave rows with unreliable odometry empty.",
        )
    turned = np.nan_to_num(np.abs(poses[:, 2]))
    if (odometry.times_s is None or odometry.timed_rows) and turned.max(initial=0) > 4 * np.pi:
        remarks.append(f"odometry: theta reaches {turned.max():g}, but must be in rad; use heading_deg for degrees")
    return [None, *(row if np.isfinite(row).all() else None for row in moved)], remarks


def _at_images(
    odometry: OdometryFile, names: Sequence[str], wanted_s: Float64[ndarray, "m"], given: Path, remarks: list[str]
) -> Float64[ndarray, "m 3"] | None:
    """Poses at the times of the images; None if the rows are images in order."""
    times = odometry.times_s
    if times is None:
        return None
    poses, known, _ = interpolated(times, odometry.poses, wanted_s, GAP_S)
    poses[~known] = np.nan
    apart = times - wanted_s if odometry.timed_rows and len(times) == len(wanted_s) > 1 else None
    if apart is not None and not known.any() and np.ptp(apart) <= np.median(np.diff(wanted_s)) / 2:
        remarks.append(f"odometry: its clock is {apart[0]:+.3f} s off the images: rows are matched to images in order")
        return None
    longer = np.ptp(times) / max(float(np.ptp(wanted_s)), SAME_S)
    if not known.any() or (known.mean() < FEW and longer > 100):
        raise UserError(
            f"odometry={given} has poses from {times[0]:.3f} s to {times[-1]:.3f} s; the images are from "
            f"{wanted_s[0]:.3f} s to {wanted_s[-1]:.3f} s, {'few' if known.any() else 'none'} at a time with a pose",
            "Do both use the same clock and unit? A column time_ms, time_us or time_ns states its unit. Without times "
            "in the names, rows are matched to images in order.",
        )
    if odometry.timed_rows:
        remarks.append("odometry: poses are interpolated at the times of the images")
    if missing := [name for name, there in zip(names, known, strict=True) if not there]:
        remarks.append(
            f"odometry: {counted(len(missing), 'image lies', 'images lie')} outside of the trajectory or in gaps of "
            f"more than {GAP_S:g} s, such as {missing[0]}: motion to and from there is unknown"
        )
    return poses


def _of_table(table: TextTable) -> OdometryFile:
    path, header, rows = table.path, list(table.header), table.rows
    if header and table.number(header[0]) is not None:  # no header
        if len(header) != 3:
            raise UserError(f"odometry={path} has {counted(len(header), 'column')} and no header", FIX)
        header, rows = ["x", "y", "theta"], [(1, header), *rows]
    if not rows:
        raise UserError(f"odometry={path} has no rows", FIX)
    angle = next((name for name in ("theta", "heading_deg") if name in header), None)
    if "x" not in header or "y" not in header or angle is None:
        raise UserError(f"odometry={path} has the columns {', '.join(header)}", FIX)
    if {"theta", "heading_deg"} <= set(header):
        raise UserError(
            f"odometry={path} has both theta and heading_deg", "Keep one of them: theta in rad, heading_deg in degrees."
        )
    timed = [name for name in header if TIME.fullmatch(name)]
    check_columns(f"odometry={path}", header, ("x", "y", angle, "file", *timed, *FRACTION))
    if problems := list(table.long_rows()):
        raise UserError(f"odometry={path}: {problems[0]} ({len(problems):,} such rows)", FIX)
    cells = {name: [row[k] if k < len(row) else "" for _, row in rows] for k, name in enumerate(header)}
    poses = np.full((len(rows), 3), np.nan)
    for column, name in enumerate(("x", "y", angle)):
        for k, word in enumerate(cells[name]):
            value = np.nan if word.lower() in ("", "nan") else table.number(word)
            if value is None:
                raise UserError(f"odometry={path}: line {rows[k][0]} is not a pose: {','.join(rows[k][1])}", FIX)
            poses[k, column] = value
    poses[~np.isfinite(poses).all(axis=1)] = np.nan
    if angle == "heading_deg":
        poses[:, 2] = np.radians(poses[:, 2])
    if "file" in header:
        files = tuple(cells["file"])
        if len(set(files)) < len(files):
            twice = next(name for name in files if files.count(name) > 1)
            raise UserError(f"odometry={path} names {twice or 'no file'} in more than one row", "One row per image.")
        return OdometryFile(poses, names=files)
    return _timed(table, poses, cells, [line for line, _ in rows])


def _timed(
    table: TextTable, poses: Float64[ndarray, "n 3"], cells: Mapping[str, Sequence[str]], lines: Sequence[int]
) -> OdometryFile:
    """Poses in the order of the time that a table has, if it has one."""
    columns = {name: matched[1] for name in cells if (matched := TIME.fullmatch(name))}
    if not columns:
        return OdometryFile(poses)
    fraction = next((each for each in FRACTION if each in cells), None)
    names = list(cells)
    before = names[names.index(fraction) - 1] if fraction else None  # time, secs, nsecs: the fraction is of the seconds
    name = before if before in columns else next(iter(columns))
    unit = columns[name]
    found: list[int] = []
    for word, more, line in zip(cells[name], cells[fraction] if fraction else cells[name], lines, strict=True):
        time = _nanoseconds(word, table.separator != ",", unit)
        rest = int(more) if fraction and more.isdecimal() else None if fraction else 0
        if time is None or rest is None:
            given = f"{name}={word!r}" if time is None else f"{fraction}={more!r}"
            raise UserError(
                f"odometry={table.path}: line {line}: {given} is not a time", "A number, of seconds or as in time_ms."
            )
        if fraction and time % SECOND:
            raise UserError(
                f"odometry={table.path}: line {line}: {name}={word} has a fraction of a second, and {fraction}={more} "
                "is another",
                f"Remove the column {fraction}.",
            )
        found.append(time + rest)
    order = sorted(range(len(found)), key=found.__getitem__)
    remarks = (
        [] if order == list(range(len(found))) else ["odometry: rows were not in order of time and have been sorted"]
    )
    kept = order[:1]
    for row in order[1:]:
        if found[row] != found[kept[-1]]:
            kept.append(row)
        elif not np.array_equal(poses[row], poses[kept[-1]], equal_nan=True):
            raise UserError(
                f"odometry={table.path}: lines {lines[kept[-1]]} and {lines[row]} have different poses at the same "
                f"time, {name}={cells[name][row]}",
                "Remove one of them.",
            )
    if len(kept) < len(order):
        remarks.append(
            f"odometry: {counted(len(order) - len(kept), 'row repeats', 'rows repeat')} a time and a pose: left out"
        )
    return OdometryFile(
        poses[kept], np.array([found[row] / SECOND for row in kept]), remarks=tuple(remarks), timed_rows=True
    )


def _nanoseconds(word: str, comma: bool, unit: str | None) -> int | None:
    """A time in nanoseconds; without a unit it is seconds, or since 1970 what its number of digits shows."""
    try:
        value = Decimal(word.replace(",", ".") if comma else word)
    except InvalidOperation:
        return None
    if not value.is_finite() or abs(value) >= 2**63:
        return None
    scale = UNITS[{"nsec": "ns", "nsecs": "ns", "sec": "s", "secs": "s"}.get(unit, unit)] if unit else None
    if scale is None:
        whole = str(int(value))
        scale = EPOCH_UNITS.get(len(whole), SECOND) if whole.startswith("1") else SECOND
    return int(value * scale)
