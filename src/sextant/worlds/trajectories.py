"""Real trajectories: readers of KITTI poses and COLD sequences."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from sextant.errors import UserError
from sextant.user_files import read_lines, read_text

#: The three rows of a rotation must be orthonormal within this tolerance.
ROTATION_TOLERANCE = 1e-3
FIX = "Set SEXTANT_DATA to the folder with kitti/poses/00.txt and cold/map.json, or use a procedural town."


@dataclass(frozen=True, eq=False)
class ColdSequence:
    """One drive of a robot through the offices of the COLD database (Pronobis & Caputo 2009).

    Attributes:
        images: names of the images, in the order of travel.
        times_s: seconds since the first image, from the file names; None if they contain no time.
        poses: x, y in metres and heading in radians, from laser localization.
        odometry: the same from the wheels, in its own coordinates; None if the file has none.
    """

    images: tuple[str, ...]
    times_s: Float[ndarray, " n"] | None
    poses: Float[ndarray, "n 3"]
    odometry: Float[ndarray, "n 3"] | None


def load_kitti_poses(path: Path | str) -> Float[ndarray, "n 4 4"]:
    """Camera poses of a KITTI odometry sequence, `world_from_camera`: x right, y down, z forward of the first camera.

    The file has a line per frame with the 12 numbers of a 3×4 matrix, row by row; comments and empty lines are left
    out. The ground plane is x, z: `plane_positions` extracts it.

    Source: A. Geiger, P. Lenz, R. Urtasun, "Are we ready for autonomous driving?", CVPR 2012.

    Raises:
        UserError: there is no such file, it is empty, a line does not have 12 finite numbers, or a matrix is not a
            rotation.

    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     _ = (file := Path(folder, "00.txt")).write_text("1 0 0 0 0 1 0 0 0 0 1 0.9")
    ...     poses = load_kitti_poses(file)
    >>> plane_positions(poses)  # of one frame, 0.9 m forwards
    array([[0. , 0.9]])
    """
    lines = read_lines(path, FIX)
    if not lines:
        raise UserError(f"{path} is empty: a line of 12 numbers for each frame is expected", "Fetch it again.")
    rows = []
    for number, line in lines:
        try:
            row = [float(word) for word in line]
        except ValueError:
            row = []
        if len(row) != 12 or not np.isfinite(row).all():
            raise UserError(
                f"{path}, line {number}: 12 finite numbers are expected, got {len(line)} words: {' '.join(line[:3])} "
                "...",
                "Each line: the rows of a 3x4 matrix. Frames without a pose cannot be left in.",
            )
        rows.append(row)
    return _as_poses(np.array(rows), path, [f"line {number}" for number, _ in lines])


def plane_positions(poses: Float[ndarray, "n 4 4"]) -> Float[ndarray, "n 2"]:
    """Positions in the ground plane of KITTI poses: x to the right and z forward of the first camera, in metres."""
    return np.ascontiguousarray(poses[:, [0, 2], 3])


def load_cold(path: Path | str) -> ColdSequence:
    """A COLD sequence from JSON: ``im_paths``, ``poses`` (12 numbers each, z up) and, with odometry, ``odom_poses``.

    The layout is that of AppearanceSeqMCL (A. Jaenal et al.), which published such files.

    Raises:
        UserError: there is no such file, it is not JSON, or a list is missing, of another length or malformed.

    >>> from tempfile import TemporaryDirectory
    >>> content = {"im_paths": ["a.jpg"], "poses": [[0, -1, 0, 3, 1, 0, 0, 4, 0, 0, 1, 0]]}  # at (3, 4), to the left
    >>> with TemporaryDirectory() as folder:
    ...     _ = (file := Path(folder, "map.json")).write_text(json.dumps(content))
    ...     load_cold(file).poses.round(2)
    array([[3.  , 4.  , 1.57]])
    """
    try:
        content: Any = json.loads(read_text(path, FIX))
    except json.JSONDecodeError as error:
        raise UserError(f"{path} is not json: {error}", "Fetch it again.") from None
    if not isinstance(content, dict) or not {"im_paths", "poses"} <= set(content):
        raise UserError(f'{path}: the lists "im_paths" and "poses" are expected', "Is this a sequence of COLD?")
    images = tuple(str(name) for name in content["im_paths"])
    matrices = _as_poses(_table(content, "poses", len(images), 12, path), path)
    poses = np.column_stack([matrices[:, :2, 3], np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0])])
    odometry = _table(content, "odom_poses", len(images), 3, path) if "odom_poses" in content else None
    return ColdSequence(images, _times(images), poses, odometry)


def _as_poses(
    rows: Float[ndarray, "n 12"], path: Path | str, names: Sequence[str] | None = None
) -> Float[ndarray, "n 4 4"]:
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows.reshape(-1, 3, 4)
    rotation = poses[:, :3, :3]
    off = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    off = np.maximum(off, 1 - np.linalg.det(rotation))  # 2 of a mirror image
    if (off > ROTATION_TOLERANCE).any():
        worst = int(np.argmax(off))
        name = names[worst] if names else f"pose {worst + 1}"
        raise UserError(f"{path}, {name}: its 3x3 part is not a rotation (off by {off.max():.2g})")
    return poses


def _table(content: dict[str, Any], key: str, rows: int, columns: int, path: Path | str) -> Float[ndarray, "n columns"]:
    try:
        table = np.array(content[key], dtype=np.float64)
    except (TypeError, ValueError):
        table = np.zeros(0)
    if rows == 0 or table.shape != (rows, columns) or not np.isfinite(table).all():
        raise UserError(f'{path}: "{key}" needs {rows} rows of {columns} finite numbers, got shape {table.shape}')
    return table


def _times(images: tuple[str, ...]) -> Float[ndarray, " n"] | None:
    stamps = [re.match(r"t(\d+\.\d+)_", name) for name in images]
    if not all(stamps):
        return None
    times = np.array([float(stamp.group(1)) for stamp in stamps if stamp])
    return np.asarray(times - times[0])
