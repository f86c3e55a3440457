"""Where images were taken, from a table or from their names.

*Tables* are CSV files with a header: ``file``, ``x``, ``y`` in metres, and optionally ``heading`` or ``heading_deg`` in
degrees. Other columns are ignored. ``file`` is the path relative to the table's folder, compared as in
:mod:`~sextant.data.name_matching`. Cells may also be separated by semicolons or tabs, and then have decimal commas.

*Names* follow the VPR community's convention, with fields separated by ``@``::

    @ UTM_east @ UTM_north @ UTM_zone_number @ UTM_zone_letter @ latitude @ longitude @ pano_id @ tile_num @ heading
    @ pitch @ roll @ height @ timestamp @ note @ extension

Only the first two are required; the others may be empty. Source: README of gmberton/VPR-datasets-downloader; G. Berton
et al., "Deep visual geo-localization benchmark", CVPR 2022. UTM coordinates are shifted :data:`ZONE_M` metres east per
zone number, and those of the southern hemisphere (zone letters below N) by their false northing, so that images far
apart stay far apart; distances across a zone's border are wrong.
"""

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sextant.data.name_matching import match_names
from sextant.data.pixel_values import warn_once
from sextant.errors import ArgumentError, UserError, problem_list
from sextant.tables import counted
from sextant.user_files import read_table

COLUMNS = ("file", "x", "y", "heading")
EAST, NORTH, ZONE, LETTER, HEADING = 1, 2, 3, 4, 9
ZONE_M = 1_000_000.0
FALSE_NORTHING_M = 10_000_000.0
#: latitude bands of UTM south of the equator
SOUTHERN = "CDEFGHJKLM"


class Pose(NamedTuple):
    """x and y in metres, and the heading in degrees or None."""

    x: float
    y: float
    heading_deg: float | None


def read_pose_table(path: Path) -> dict[str, Pose]:
    """Read poses by file name.

    Raises:
        UserError: the table cannot be read, lacks a column, lists a file twice, or has a value that is not a finite
            number; the message names the file, the rows and the values.
    """
    table = read_table(path, f"A CSV file with {','.join(COLUMNS)}")
    header = ["heading" if name == "heading_deg" else name for name in table.header]
    lacking = [name for name in COLUMNS[:3] if header.count(name) != 1]
    if lacking or header.count("heading") > 1:
        raise UserError(
            f"{path}: columns {', '.join(header) or '(none)'}; the first line must name file, x and y once each, "
            "and may name heading",
            "file,x,y,heading\nfirst.jpg,12.5,-3.0,90",
        )
    where = [header.index(name) for name in COLUMNS if name in header]
    poses: dict[str, Pose] = {}
    problems = list(table.long_rows())
    for number, row in table.rows:
        line = f"line {number}"
        if len(row) < len(header):
            if any(row):
                problems.append(f"{line}: {counted(len(row), 'value')} for {counted(len(header), 'column')}")
            continue
        file, *cells = (row[k] for k in where)
        numbers = [table.number(cell) for cell in cells]
        wrong = [f"{name}={cell!r}" for name, cell, n in zip(COLUMNS[1:], cells, numbers, strict=False) if n is None]
        name = Path(file).as_posix()
        if wrong:
            problems.append(
                f"{line}: {', '.join(wrong)} of {name} must be "
                f"{'a finite number' if len(wrong) == 1 else 'finite numbers'}"
            )
        elif name in poses:
            problems.append(f"{line}: {name} has a row already")
        else:
            x, y, *heading = (float(n) for n in numbers if n is not None)
            poses[name] = Pose(x, y, heading[0] if heading else None)
    if poses:
        _warn_of_headings(path, list(poses.values()), table.header)
    if problems:
        raise UserError(
            f"{path}: {counted(len(problems), 'row')} cannot be used\n{problem_list(problems)}",
            "Correct them, or remove these rows and their images.",
        )
    return poses


#: headings follow the way if the length of the mean unit vector between them is above the first, and do not if it is
#: below the second; set by hand, between 1 for headings along the way and 0 for unrelated ones
FOLLOWS, DOES_NOT = 0.9, 0.5


def _warn_of_headings(path: Path, poses: list[Pose], header: Sequence[str]) -> None:
    """Warn of headings in a column that is not read, and of those that only follow the way if they are radians."""
    unread = next((name for name in ("theta", "yaw") if name in header), None)
    if poses[0].heading_deg is None and unread is not None:
        warn_once(f"{path}: the column {unread} is not read; headings are degrees in a column heading")
    if poses[0].heading_deg is None or len(poses) < 3:
        return
    x, y, headings = np.array(poses, float).T
    steps, turned = np.diff(x) + 1j * np.diff(y), np.abs(headings).max() <= 2 * math.pi
    moved, before = np.abs(steps) > 0, headings[:-1]
    if not (turned and moved.any()):
        return
    way = steps[moved] / np.abs(steps[moved])
    degrees, radians = (abs(np.mean(way * np.exp(-1j * scale * before[moved]))) for scale in (math.pi / 180, 1.0))
    if radians > FOLLOWS and degrees < DOES_NOT:
        warn_once(
            f"{path}: headings of at most {np.abs(headings).max():.3g} follow the way as radians, not as degrees: the "
            "column heading must be in degrees"
        )


def parse_utm_name(name: str) -> Pose | None:
    """The pose in a file's name, or None if the name does not follow the convention."""
    fields = Path(name).stem.split("@")
    if len(fields) <= NORTH or fields[0]:
        return None
    fields += [""] * (HEADING + 1 - len(fields))
    east, north = _number(fields[EAST]), _number(fields[NORTH])
    zone = 0.0 if not fields[ZONE].strip() else _number(fields[ZONE])
    letter, heading = fields[LETTER].strip().upper(), fields[HEADING].strip()
    angle = _number(heading) if heading else None
    if east is None or north is None or zone is None or (heading and angle is None) or len(letter) > 1:
        return None
    south = bool(letter) and letter in SOUTHERN
    return Pose(east + ZONE_M * zone, north - FALSE_NORTHING_M * south, angle)


def utm_poses(paths: Sequence[Path], key: str) -> list[Pose]:
    """The poses in the names of files.

    Raises:
        UserError: names do not follow the convention; the message lists them.
    """
    poses = [parse_utm_name(path.name) for path in paths]
    wrong = [path.name for path, pose in zip(paths, poses, strict=True) if pose is None]
    if wrong:
        raise ArgumentError(
            f"{key}: {len(wrong):,} of {counted(len(paths), 'name')} {'contains' if len(wrong) == 1 else 'contain'} "
            f"no pose\n{problem_list(wrong)}",
            "places=utm needs names such as @0548939.41@4179162.31@10@S@@@@@180@@@@@@.jpg: easting, northing "
            "in metres,\nzone number, zone letter, latitude, longitude, pano_id, tile, heading, pitch, roll, height, "
            "time, note; all after northing may be empty.",
        )
    return [pose for pose in poses if pose is not None]


def table_poses(paths: Sequence[Path], folder: Path, table: Path, key: str) -> list[Pose]:
    """The poses of files from a table in a folder around them.

    Args:
        paths: of the images, below the folder with links resolved.
        folder: of the traverse; rows for missing files below it are an error.
        table: the CSV file.
        key: of the config, for messages.

    Raises:
        UserError: an image has no row, or a row no image; the message names them.
    """
    poses, root = read_pose_table(table), folder.resolve()
    inside = Path(os.path.relpath(folder, table.parent))  # as it was named: folders and files may be links
    names, listed = [(inside / path.relative_to(root)).as_posix() for path in paths], list(poses)
    rows = match_names(names, listed, whole=inside != Path()).refuse_ambiguous(f"{key}: {table}").rows
    if unplaced := [name for name, row in zip(names, rows, strict=True) if row is None]:
        raise ArgumentError(
            f"{key}: {len(unplaced):,} of {counted(len(names), 'image')} {'has' if len(unplaced) == 1 else 'have'} no "
            f"row in {table}\n{problem_list(unplaced)}",
            "Add rows of file,x,y, with paths relative to the table's folder, or remove these images.",
        )
    below = f"{inside.as_posix()}/"
    own = {name for name in poses if inside == Path() or name.replace("\\", "/").startswith(below)}
    matched = [listed[row] for row in rows if row is not None]
    absent = sorted(name for name in own - set(matched) if not (table.parent / name).is_file())
    if absent:
        raise ArgumentError(
            f"{key}: {counted(len(absent), 'row')} of {table} {'has' if len(absent) == 1 else 'have'} no "
            f"image\n{problem_list(absent)}",
            "Add these images, or remove their rows.",
        )
    return [poses[name] for name in matched]


def _number(text: str) -> float | None:
    """A finite number, or None."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
