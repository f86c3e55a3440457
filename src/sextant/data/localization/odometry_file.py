"""Odometry of the user's own images: a trajectory in TUM format, or a table with one row per image."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from sextant.data.localization.motions import between
from sextant.data.localization.pose_formats import read_tum
from sextant.data.positions import FURTHEST
from sextant.errors import UserError

#: widest gap in seconds over which poses are interpolated
GAP_S = 5.0
#: an image this near to a pose in time has that pose
SAME_S = 1e-3
FIX = (
    "A table with commas: columns x,y,theta (metres, rad) or x,y,heading_deg, a row an image; or TUM: timestamp tx ty "
    "tz qx qy qz qw."
)


@dataclass(frozen=True, eq=False)
class OdometryFile:
    """Poses in their own frame of reference; a row of nan is unknown.

    Attributes:
        poses: x, y, heading.
        times_s: increasing times in seconds; None for a table.
        names: the file of each row, if the table has them.
    """

    poses: Float64[ndarray, "n 3"]
    times_s: Float64[ndarray, "n"] | None = None
    names: tuple[str, ...] | None = None


def read_odometry(path: Path) -> OdometryFile:
    """Read a table if the first line that is not a comment has commas, otherwise TUM.

    Raises:
        UserError: it is neither; the message names the file and the line.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"odometry={path} cannot be read: {error}", FIX) from None
    first = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    if not first:
        raise UserError(f"odometry={path} has no rows", FIX)
    if "," not in first:
        if len(first.split()) != 8:
            raise UserError(
                f"odometry={path} is neither a table with commas nor TUM; it begins with {first[:40]!r}", FIX
            )
        try:
            times, poses = read_tum(path)
        except UserError as error:
            raise UserError(f"odometry={error.problem}", FIX) from None
        return OdometryFile(poses, times)
    return _table(path, lines)


def motions_of(
    odometry: OdometryFile,
    names: Sequence[str],
    times_s: Float64[ndarray, "n"] | None,
    given: Path,
    every: int = 1,
    frames: int | None = None,
) -> tuple[list[Float64[ndarray, "3"] | None], list[str]]:
    """The motion to each image from the one before, None where it is unknown, and remarks for the user.

    With a time in every name, poses of a TUM trajectory are taken at those times; otherwise rows are images in order.

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
    remarks: list[str] = []
    poses = odometry.poses
    if odometry.times_s is not None and times_s is not None and frames is None:
        poses, known = _at(odometry.times_s, poses, times_s)
        if not known.any():
            raise UserError(
                f"odometry={given} has poses from {odometry.times_s[0]:.3f} s to {odometry.times_s[-1]:.3f} s; the "
                f"images are of {times_s[0]:.3f} s to {times_s[-1]:.3f} s by their names, none at a time with poses",
                "Do both use the same clock? Without times in the names, each row is an image.",
            )
        missing = [name for name, there in zip(names, known, strict=True) if not there]
        if missing:
            remarks.append(
                f"odometry: {len(missing):,} images such as {missing[0]} lie outside of the trajectory or in gaps of "
                f"more than {GAP_S:g} s: their motion is unknown"
            )
    elif frames is not None and len(poses) == frames:
        poses = poses[::every]
    if len(poses) != len(names):
        raise UserError(
            f"odometry={given} has {len(poses):,} rows for {len(names):,} images, {names[0]} to {names[-1]}",
            "One row per image, in order; or a trajectory in TUM's format and file names in seconds; or a table "
            "with a column file.",
        )
    if odometry.times_s is not None and times_s is None:
        wide = np.flatnonzero(np.diff(odometry.times_s) > GAP_S)
        if len(wide):
            at = int(wide[0]) + 1
            remarks.append(
                f"odometry: {len(wide):,} gaps in time above {GAP_S:g} s, the first, of "
                f"{odometry.times_s[at] - odometry.times_s[at - 1]:.1f} s, before {names[at]}"
            )
    unknown = int((~np.isfinite(poses).all(axis=1)).sum())
    if unknown and odometry.times_s is None:
        remarks.append(f"odometry: {unknown:,} of {len(poses):,} rows are empty: motion to and from them is unknown")
    moved = between(poses[:-1], poses[1:])
    far = np.nan_to_num(np.abs(moved).max(axis=1)) > FURTHEST
    if far.any():
        at = int(far.argmax())
        raise UserError(
            f"odometry={given} moves by {moved[at, 0]:.3g}, {moved[at, 1]:.3g} from {names[at]} to {names[at + 1]}",
            "Leave a row empty whose odometry cannot be trusted.",
        )
    turned = np.nan_to_num(np.abs(poses[:, 2]))
    if odometry.times_s is None and turned.max(initial=0) > 4 * np.pi:
        remarks.append(f"odometry: theta reaches {turned.max():g}, and is in rad; a column heading_deg holds degrees")
    return [None, *(row if np.isfinite(row).all() else None for row in moved)], remarks


def _at(
    times_s: Float64[ndarray, "n"], poses: Float64[ndarray, "n 3"], wanted_s: Float64[ndarray, "m"]
) -> tuple[Float64[ndarray, "m 3"], Bool[ndarray, "m"]]:
    """Poses at other times, and which of them are known."""
    after = np.clip(np.searchsorted(times_s, wanted_s), min(1, len(times_s) - 1), len(times_s) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.minimum(np.abs(wanted_s - times_s[before]), np.abs(wanted_s - times_s[after]))
    inside = (wanted_s >= times_s[0]) & (wanted_s <= times_s[-1]) & (times_s[after] - times_s[before] <= GAP_S)
    known = inside | (nearest <= SAME_S)
    x, y = (np.interp(wanted_s, times_s, poses[:, k]) for k in (0, 1))
    heading = np.interp(wanted_s, times_s, np.unwrap(poses[:, 2]))
    found = np.column_stack([x, y, heading])
    found[~known] = np.nan
    return found, known


def _table(path: Path, lines: Sequence[str]) -> OdometryFile:
    rows = list(csv.reader(line for line in lines if line.strip() and not line.startswith("#")))
    header = [word.strip().lower() for word in rows[0]]
    if _number(header[0]) is not None:  # no header
        if len(header) != 3:
            raise UserError(f"odometry={path} has {len(header)} columns and no line that names them", FIX)
        header, rows = ["x", "y", "theta"], [[], *rows]
    angle = next((name for name in ("theta", "heading_deg") if name in header), None)
    if "x" not in header or "y" not in header or angle is None:
        raise UserError(f"odometry={path} has the columns {', '.join(header)}", FIX)
    columns = [header.index(name) for name in ("x", "y", angle)]
    poses = np.full((len(rows) - 1, 3), np.nan)
    for number, row in enumerate(rows[1:]):
        words = [row[column].strip() if column < len(row) else "" for column in columns]
        values = [np.nan if word in ("", "nan") else _number(word) for word in words]
        if any(value is None for value in values):
            raise UserError(f"odometry={path}: row {number + 1} is not a pose: {','.join(row)}", FIX)
        poses[number] = values
    if not len(poses):
        raise UserError(f"odometry={path} has no rows", FIX)
    poses[~np.isfinite(poses).all(axis=1)] = np.nan
    if angle == "heading_deg":
        poses[:, 2] = np.radians(poses[:, 2])
    if "file" not in header:
        return OdometryFile(poses)
    files = tuple(row[header.index("file")].strip() if header.index("file") < len(row) else "" for row in rows[1:])
    if len(set(files)) < len(files):
        twice = next(name for name in files if files.count(name) > 1)
        raise UserError(f"odometry={path} names {twice or 'no file'} in more than one row", "One row per image.")
    return OdometryFile(poses, names=files)


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None
