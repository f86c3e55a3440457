"""Files of poses in any format, and the images that they belong to."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.chapters.localization.data.odometry_file import FRACTION, TIME, read_odometry
from sextant.chapters.localization.data.pose_folder import PoseFormat
from sextant.chapters.localization.data.pose_formats import read_kitti, read_tum_matrices
from sextant.chapters.localization.data.pose_times import times_of_names
from sextant.chapters.localization.data.recorded_poses import RECORDED, read_recorded, recorded_format
from sextant.chapters.places.data.pose_files import read_pose_table
from sextant.data.name_matching import match_names
from sextant.data.photo_files import reason_alone
from sextant.data.reconstructions import NAMED_FORMATS, named_format, read_reconstruction
from sextant.data.reconstructions.json_file import read_foreign_json
from sextant.errors import UserError
from sextant.tables import counted
from sextant.user_files import table_header
from sextant.worlds.trajectories import load_cold

PosesFormat = PoseFormat | Literal["cold"]
#: number of first bytes from which a format is detected
HEAD = 65536
#: larger JSON is read only if its name is that of a reconstruction
LARGEST_JSON = 64 * 2**20
#: a pose that is further than this from an image in time does not belong to it
NEAR_S = 5.0
#: columns of a pose in a table of odometry, one of the last two
POSE = ("x", "y", "theta", "heading_deg")
#: beginnings of names of files whose poses are odometry
ODOMETRY = ("odom", "vo.")
UNIT = 0.05  # a quaternion or a row of a rotation has length 1 to within this


@dataclass(frozen=True, eq=False)
class FoundPoses:
    """A file of poses.

    Attributes:
        file: relative to the folder that is inspected; for GPS the folder of the photos.
        format: see :class:`~sextant.chapters.localization.data.PoseFolder`; also ``cold``, sequences of that database.
        count: number of poses.
        images: folder of the images that they may belong to, relative; None if there is none.
        posed: number of images there with a pose.
        unposed: number of images there without a pose.
        without_image: number of poses without an image.
        headings: the poses include viewing directions.
        times_s: first and last time, in TUM's format.
        problem: why the file cannot be used; "" if it can.
        remarks: remarks for the user.
        poses: ``world_from_body`` of 3D poses.
        names: names of the images, where poses have names.
    """

    file: Path
    format: PosesFormat
    count: int = 0
    images: Path | None = None
    posed: int = 0
    unposed: int = 0
    without_image: int = 0
    headings: bool = True
    times_s: tuple[float, float] | None = None
    problem: str = ""
    remarks: tuple[str, ...] = ()
    poses: Float64[ndarray, "n 4 4"] | None = None
    names: tuple[str, ...] = field(default=(), repr=False)


def separate_models(poses: Sequence[FoundPoses]) -> str:
    """A remark on several COLMAP models of the same images, each in its own frame; "" if there is only one."""
    models: dict[Path, FoundPoses] = {}
    for each in poses:  # a model may be exported as text beside its binary files
        if each.format == "colmap" and not each.problem:
            models.setdefault(each.file.parent, each)
    for folder in dict.fromkeys(path.parent for path in models):
        beside = sorted((each for path, each in models.items() if path.parent == folder), key=lambda each: -each.posed)
        if len(beside) > 1 and folder not in models:
            named = ", ".join(f"{each.file.as_posix()} ({counted(each.posed, 'image')})" for each in beside)
            return (
                f"{len(beside)} reconstructions, each in its own frame: {named}; the largest is used; another is "
                "chosen by dataset.pose_file=<file>, or by map=<file> of sextant walk"
            )
    return ""


def found_poses(folder: Path, file: Path, images: Sequence[Path]) -> FoundPoses | None:
    """Read the poses of a file; None if it has none.

    Args:
        folder: the folder that is inspected.
        file: the file, relative to it.
        images: images that can be read, relative to it.
    """
    with np.errstate(all="ignore"):  # numbers of damaged files may be of any size
        kind = _format(folder / file)
        if kind is None:
            return None
        around = _images_around(file, images)
        if around is not None and kind in RECORDED:  # of several cameras, the first
            around = min(path.parent for path in images if path.is_relative_to(around))
        own = [] if around is None else [path for path in images if path.is_relative_to(around)]
        try:
            return _read(folder, file, kind, around, own)
        except UserError as error:
            return FoundPoses(file, kind, images=around, problem=reason_alone(str(folder / file), error.problem))


def odometry_tables(folder: Path, files: Sequence[Path]) -> tuple[dict[Path, int], dict[str, str]]:
    """Tables of odometry with their numbers of rows; and for those with its columns that cannot be used, the reason.

    A table is one by its name, or if it has no columns but those of poses and times, so that no image is named.
    """
    found: dict[Path, int] = {}
    unusable: dict[str, str] = {}
    for file in files:
        columns = set(table_header(folder / file))
        bare = all(TIME.fullmatch(each) or each in (*POSE, *FRACTION) for each in columns)
        if file.name.lower().startswith(ODOMETRY) or (bare and len(columns & set(POSE)) >= 3):
            try:
                found[file] = len(read_odometry(folder / file).poses)
            except UserError as error:
                if len(columns & set(POSE)) >= 3:
                    unusable[file.as_posix()] = reason_alone(f"odometry={folder / file}", error.problem)
    return found, unusable


def _format(path: Path) -> PosesFormat | None:
    """Detect the format by the name and the beginning of a file."""
    suffix = path.suffix.lower()
    if suffix == ".json":
        return _format_of_json(path)
    lines = [] if suffix == ".bin" else _first_lines(path)
    if suffix == ".csv":
        names = table_header(path)
        if (recorded := recorded_format(names)) is not None:
            return None if path.name.lower().startswith(ODOMETRY) else recorded
        header = set(names)
        return "csv" if {"file", "x", "y"} <= header or path.name == "poses.csv" else None
    numbers = [_float(word) for word in lines[0].split()] if lines else []
    if None in numbers or len(numbers) not in (8, 12):
        return named_format(path)
    values = np.array(numbers, np.float64)
    rows = values[4:][None] if len(values) == 8 else values.reshape(3, 4)[:, :3]
    lengths = np.linalg.norm(rows, axis=1)  # of a quaternion, or of the rows of a rotation matrix
    lost = np.isnan(lengths) | (lengths == 0)  # written where tracking was lost: to be reported, not passed over
    if not bool((lost | (np.abs(lengths - 1) < UNIT)).all()):
        return None
    return "tum" if len(values) == 8 else "kitti"


def _first_lines(path: Path) -> list[str]:
    """Lines that are not comments; none if the file cannot be read."""
    try:
        with path.open("rb") as opened:
            text = opened.read(HEAD).decode("utf-8-sig", "replace")
    except OSError:
        return []
    return [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def _format_of_json(path: Path) -> PosesFormat | None:
    named = path.name.startswith(("reconstruction", "transforms"))
    try:
        if not named and path.stat().st_size > LARGEST_JSON:
            return None
    except OSError:
        return None
    try:
        content: Any = read_foreign_json(path, "")
    except UserError:
        return named_format(path) if named else None
    if isinstance(content, dict) and {"im_paths", "poses"} <= set(content):
        return "cold"
    if isinstance(content, dict) and isinstance(content.get("frames"), list):
        return "nerfstudio"
    shots = isinstance(content, list) and any(isinstance(each, dict) and "shots" in each for each in content)
    return "opensfm" if shots else None


def _images_around(file: Path, images: Sequence[Path]) -> Path | None:
    """The nearest folder around a file that contains images: ``sparse/0/images.bin`` lies two levels below it.

    If that folder has a subfolder ``images``, as with COLMAP and nerfstudio, it is that one: smaller copies lie beside
    it.
    """
    parents = (inner for folder in file.parents for inner in (folder / "images", folder))
    return next((folder for folder in parents if any(path.is_relative_to(folder) for path in images)), None)


def _read(folder: Path, file: Path, kind: PosesFormat, around: Path | None, images: list[Path]) -> FoundPoses:
    path = folder / file
    if kind == "csv":
        table = read_pose_table(path)
        told = [image.relative_to(file.parent).as_posix() for image in images if image.is_relative_to(file.parent)]
        matches = match_names(told, list(table))
        rows = {row for row in matches.rows if row is not None}
        without = sum(row not in rows and not (path.parent / name).is_file() for row, name in enumerate(table))
        headings = all(pose.heading_deg is not None for pose in table.values())
        return FoundPoses(
            file, kind, len(table), around, len(rows), len(images) - len(rows), without, headings,
            remarks=tuple(filter(None, [matches.remark])),
        )  # fmt: skip
    if kind in NAMED_FORMATS:
        found = read_reconstruction(path, kind)
        matches = found.match([image.as_posix() for image in images])
        own = [image for image, row in zip(images, matches.rows, strict=True) if row is not None]
        if own and len(own) < len(images):  # the others may be of another split
            around = Path(os.path.commonpath([image.parent for image in own]))
            images = [image for image in images if image.is_relative_to(around)]
        return FoundPoses(
            file, kind, len(found.images), around, len(own), len(images) - len(own), len(found.images) - len(own),
            remarks=tuple(filter(None, [*found.remarks, matches.remark])), poses=found.poses, names=tuple(found.names),
        )  # fmt: skip
    if kind == "cold":
        return FoundPoses(file, kind, len(load_cold(path).poses))
    times = None
    if kind == "kitti":
        poses = read_kitti(path)
    else:
        times, poses = read_tum_matrices(path) if kind == "tum" else read_recorded(path)
    span = None if times is None else (float(times[0]), float(times[-1]))
    posed, without, remarks = _by_time_or_number(len(poses), times, images)
    return FoundPoses(
        file, kind, len(poses), around, posed, len(images) - posed, without, times_s=span, remarks=remarks, poses=poses
    )


def _by_time_or_number(
    count: int, times_s: Float64[ndarray, "n"] | None, images: list[Path]
) -> tuple[int, int, tuple[str, ...]]:
    """How many images have a pose, how many poses have no image, and a remark on that."""
    taken = None if times_s is None or not images else times_of_names(images)
    if taken is None or times_s is None:
        if len(images) in (0, count):
            return len(images), count - len(images), ()
        remark = f"{counted(count, 'pose')} for {counted(len(images), 'image')}, and no times by which to match them"
        return 0, 0, (remark,)
    after = np.clip(np.searchsorted(times_s, taken), 1, max(1, count - 1))
    gaps = np.minimum(np.abs(taken - times_s[after - 1]), np.abs(taken - times_s[np.minimum(after, count - 1)]))
    posed = int((gaps <= NEAR_S).sum())
    return posed, 0, () if posed else ("no pose is near in time to an image: do both use the same clock?",)


def _float(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None
