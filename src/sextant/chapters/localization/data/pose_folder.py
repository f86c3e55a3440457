"""The user's own drives: a folder of images per drive, and a file of poses in one of the usual formats."""

import copy
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float64
from numpy import ndarray

from sextant.atomic_files import file_sha256
from sextant.chapters.localization.data.drive import (
    Drive,
    LocalizationData,
    compose,
    first_share,
    motions_along,
)
from sextant.chapters.localization.data.odometry_file import is_odometry_table, is_timed, read_odometry
from sextant.chapters.localization.data.pose_formats import (
    Ahead,
    Plane,
    read_kitti,
    read_tum_matrices,
    to_plane,
)
from sextant.chapters.localization.data.pose_times import (
    check_gaps,
    check_rising,
    names_without_time,
    no_times,
    poses_at,
    times_of_file,
    times_of_names,
)
from sextant.chapters.localization.data.recorded_poses import RECORDED, read_recorded
from sextant.chapters.localization.data.simulated import DriveSettings, Split
from sextant.chapters.places.data.aligned import traverse_files
from sextant.chapters.places.data.decoded_images import ImageSize, Together, read_images
from sextant.chapters.places.data.gps_poses import drive_by_gps
from sextant.chapters.places.data.pose_files import table_poses
from sextant.data.reconstructions import NAMED_FORMATS, read_reconstruction
from sextant.data.source import MissingDataError, first_folder
from sextant.errors import ArgumentError, problem_list
from sextant.evaluation.protocols import OFFICE_LOCALIZATION, TOWN_LOCALIZATION
from sextant.localization.map_support import map_spacing
from sextant.ranges import Positive, checked
from sextant.tables import counted

PoseFormat = Literal["csv", "tum", "kitti", "colmap", "opensfm", "nerfstudio", "gps", "euroc", "robotcar", "nclt"]
FILES: dict[PoseFormat, str] = {
    "csv": "poses.csv",
    "tum": "poses.txt",
    "kitti": "poses.txt",
    "colmap": "images.bin",
    "opensfm": "reconstruction.json",
    "nerfstudio": "transforms.json",
    "gps": ".",  # the images
    "euroc": "../../state_groundtruth_estimate0/data.csv",  # from mav0/cam0/data
    "robotcar": "../../gps/ins.csv",  # from stereo/centre
    "nclt": "../../groundtruth_*.csv",  # from lb3/Cam5; the only such file
}
#: formats whose poses have times
TIMED = ("tum", *RECORDED)
#: of each test drive, if there are no drives for validation
VALIDATION_SHARE = 0.25


@dataclass(frozen=True, eq=False)
class _Frames:
    """What a folder contains, before an image is decoded."""

    paths: list[Path]
    poses: Float64[ndarray, "n 3"]
    odometry: Float64[ndarray, "n 3"] | None
    times_s: Float64[ndarray, "n"] | None


class PoseFolder:
    """Folders of images with poses.

    ========= ==========================================================================================================
    ``csv``   a table ``file,x,y,heading`` in metres and degrees counter-clockwise from x, already in the plane
    ``tum``   lines ``timestamp tx ty tz qx qy qz qw``; an image has the pose at the time in its name, interpolated, or,
              where names contain no time, the pose of its number
    ``kitti`` lines of 12 numbers, the rows of a 3x4 matrix ``world_from_camera``; the i-th image has the i-th pose
    ========= ==========================================================================================================

    ``colmap`` (``images.bin`` or ``images.txt``), ``opensfm`` and ``nerfstudio`` give poses by image name, see
    :mod:`sextant.data.reconstructions`; their lengths are metres only if that program knew the scale. ``gps`` takes
    positions from the EXIF block of each image, in metres east and north of the map's first image: see
    :mod:`~sextant.chapters.places.data.gps_poses`. ``euroc``, ``robotcar`` and ``nclt`` are matched by times as ``tum``
    is: see :mod:`~sextant.chapters.localization.data.recorded_poses`.

    Images are in the natural order of their names. Poses in space are projected to a plane by
    :func:`~sextant.chapters.localization.data.pose_formats.to_plane`. The *camera* is localized: its pose is that of
    the file composed with ``mounting``.

    Args:
        folder: the folder that contains the drives, absolute, or relative to the working directory or one of the
            ``roots``.
        map: folder of the drive that makes the map, below ``folder``.
        test: folder of each drive to localize, by name; None for the folder ``run``.
        validation: likewise for fitting temperatures and noise; None takes them from the start of each test drive.
        poses: format of the pose files.
        pose_file: name of that file, from each drive's folder, with ``*`` for what differs; None for the usual name.
        odometry: name of a file of the same format with odometry poses in their own frame of reference, or of a table
            ``x,y,theta`` with times or a row for each image; None for no odometry.
        times: ``names`` (seconds, or whole nano- or microseconds), ``order``, or a file with one line per image; None
            for ``names`` with poses or odometry that have times if all names contain a time, otherwise ``order``.
        plane: the world axes that the robot moves along.
        ahead: the axis of the posed body that points ahead, ``z`` for a camera and ``x`` for a robot.
        mounting: where the camera is on the posed body: metres ahead, metres to the left, degrees to the left.
        protocol: the rules by which success is judged, ``office`` or ``town``.
        max_gap_s: longest time between two images of a drive, and between the poses around an image; None for any.
        height: rows that images are stretched to.
        width: columns that images are stretched to.
        channels: 3 for colour, 1 for grey.
        skip_bad: leave out images that cannot be decoded, and map images with exactly the same pose as another.
        roots: further folders to search; decoded images are kept in the last.

    Raises:
        UserError: an argument is invalid.
    """

    name = "pose_folder"

    @checked
    def __init__(
        self,
        folder: str,
        map: str = "map",
        test: Mapping[str, str] | None = None,
        validation: Mapping[str, str] | None = None,
        poses: PoseFormat = "csv",
        pose_file: str | None = None,
        odometry: str | None = None,
        times: str | None = None,
        plane: Plane = "xy",
        ahead: Ahead = "z",
        mounting: Sequence[float] = (0.0, 0.0, 0.0),
        protocol: Literal["office", "town"] = "office",
        max_gap_s: Positive | None = 5.0,
        height: int = 64,
        width: int = 96,
        channels: int = 3,
        skip_bad: bool = False,
        roots: Sequence[Path | str] = (),
    ):
        if poses == "gps" and (pose_file or odometry):
            wrong, file = ("pose_file", pose_file) if pose_file else ("odometry", odometry)
            raise ArgumentError(f"{wrong}={file}: poses=gps takes poses from the images alone", f"{wrong}=null")
        if len(mounting) != 3 or not np.isfinite(mounting).all():
            raise ArgumentError(
                f"mounting={list(mounting)} must be metres ahead, metres to the left, degrees to the left",
                "mounting=[0,0,0] if the poses are those of the camera",
            )
        self.poses, self.pose_file, self.odometry, self.times = poses, pose_file or FILES[poses], odometry, times
        self.plane, self.ahead, self.protocol, self.max_gap_s = plane, ahead, protocol, max_gap_s
        x, y, yaw = (float(value) for value in mounting)
        self.mounting = np.array([[x, y, np.radians(yaw)]])
        self.folders: dict[Split, dict[str, str]] = {
            "map": {"map": map},
            "validation": {f"validation/{name}": path for name, path in (validation or {}).items()},
            "test": dict(test or {"run": "run"}),
        }
        self.looked = [Path(folder).expanduser().absolute(), *(Path(root) / folder for root in roots)]
        self.cache = Path(roots[-1]) if roots else None
        self.size, self.skip_bad = ImageSize(height, width, channels), skip_bad
        self.settings = DriveSettings()

    def with_settings(self, settings: DriveSettings) -> "PoseFolder":
        """The same folders with another share for validation."""
        other = copy.copy(self)
        other.settings = settings
        return other

    @property
    def folder(self) -> Path:
        """The first of the searched paths that is a folder."""
        return first_folder(
            self.looked,
            "folder",
            "Give the folder that contains the drives: folder=/path/to/drives map=map "
            "test='{run: run}'. Without images of your own: dataset=office_walk",
        )

    def conditions(self) -> tuple[str, ...]:
        """``map``, and the names of the test drives."""
        return ("map", *self.folders["test"])

    def files(self, split: Split) -> list[Path]:
        """The images of a split and their pose files; nothing is decoded.

        Raises:
            UserError: a folder or a file is missing, or two drives have files in common.
        """
        images = self._images()
        found: list[Path] = []
        for name, folder in self.folders[split].items():
            found += [*images[name], *self._tables(self.folder / folder, _key(split, name), split)]
        return found

    def fingerprint(self) -> str:
        """Hash of the contents of all images and poses, and of how they are interpreted."""
        files = [[path.name, file_sha256(path)] for split in self.folders for path in self.files(split)]
        meant = [self.poses, self.odometry, self.times, self.plane, self.ahead, self.mounting.tolist(), self.protocol]
        size = [self.size.height, self.size.width, self.size.channels, self.skip_bad, self.max_gap_s]
        digest = hashlib.sha256(json.dumps([files, list(self.conditions()), meant, size]).encode()).hexdigest()
        return self.settings.identity(digest)

    def read(self) -> LocalizationData:
        """All drives; images are decoded the first time and memory-mapped from the cache afterwards.

        Raises:
            UserError: files are missing, out of order, of different lengths or cannot be read; the message names them.
        """
        images = self._images()
        notes: list[str] = []
        drives: dict[Split, list[Drive]] = {split: [] for split in self.folders}
        for split, folders in self.folders.items():
            for name, folder in folders.items():
                drives[split].append(self._drive(split, name, self.folder / folder, images, notes))
        if self.odometry is None:
            notes.append("odometry=null: the motion between images is unknown")
        (first,), test, validation = drives["map"], tuple(drives["test"]), tuple(drives["validation"])
        limit = {"office": OFFICE_LOCALIZATION, "town": TOWN_LOCALIZATION}[self.protocol].position
        if (spacing := map_spacing(torch.from_numpy(first.poses))) > limit:
            notes.append(
                f"protocol={self.protocol}: the map's images are {spacing:.2g} m apart, further than the {limit:g} m "
                "within which a pose counts as correct"
                + ("; protocol=town allows 5 m" if self.protocol == "office" else "")
            )
        if not validation:
            if short := [drive.name for drive in test if len(drive) < 2]:
                raise ArgumentError(f"test.{short[0]} has only one image, too few to localize", "Add images.")
            validation, test = first_share(test, self.settings.share(VALIDATION_SHARE))
        return LocalizationData(first, test, validation, None, "m", self.protocol, notes=tuple(notes))

    def mapped_images(self) -> tuple[list[Path], Float64[ndarray, "n 3"], list[str]]:
        """The images of the map and their camera poses, with notes for the user; nothing is decoded.

        Raises:
            UserError: the folder has no images, or no poses for them.
        """
        notes: list[str] = []
        paths = self._of_map()
        poses = self._frames("map", self.folder / self.folders["map"]["map"], paths, "map", notes).poses
        once = self._once(poses, paths, "map", notes)
        return [paths[i] for i in once.tolist()], poses[once], notes

    def _of_map(self) -> list[Path]:
        return traverse_files({"map": self.folder / self.folders["map"]["map"]}, "")["map"]

    def _images(self) -> dict[str, list[Path]]:
        """The images of all drives, which must be disjoint."""
        all_folders = {name: self.folder / path for part in self.folders.values() for name, path in part.items()}
        return traverse_files(all_folders, "")

    def _tables(self, folder: Path, key: str, split: Split) -> list[Path]:
        """The files beside the images of a drive."""
        wanted = [] if self.poses == "gps" else [("pose_file", self.pose_file)]
        if split != "map":
            wanted += [("odometry", name) for name in (self.odometry,) if name]
        if self.times not in (None, "names", "order"):
            wanted.append(("times", str(self.times)))
        files = [_only(folder, name, argument) for argument, name in wanted]
        for (argument, name), file in zip(wanted, files, strict=True):
            if not file.is_file():
                what = "poses" if argument == "pose_file" else argument
                raise MissingDataError(
                    f"{key}: {folder} has no {what}, the file {name}",
                    f"Put it there, or give its name: {argument}=<name>",
                )
        return files

    def _drive(
        self, split: Split, name: str, folder: Path, images_of: Mapping[str, list[Path]], notes: list[str]
    ) -> Drive:
        key, paths = _key(split, name), images_of[name]
        frames = self._frames(split, folder, paths, key, notes)
        what = f"{name} images of dataset={self.name}"
        together = Together(f"dataset={self.name}", lambda: [path for paths in images_of.values() for path in paths])
        decoded = read_images(paths, self.size, self.cache, what=what, skip_bad=self.skip_bad, together=together)
        notes += [f"left out {bad}" for bad in decoded.bad]
        kept, images = decoded.kept, decoded.images
        if split == "map":
            once = self._once(frames.poses[kept], [paths[i] for i in kept.tolist()], key, notes)
            kept, images = kept[once], images.select(once)
        motion = None
        if split != "map":
            unknown = np.concatenate([np.zeros((1, 3)), np.full((len(kept) - 1, 3), np.nan)])
            motion = unknown if frames.odometry is None else motions_along(frames.odometry[kept])
        return Drive.of(
            name,
            name.removeprefix("validation/"),
            frames.poses[kept],
            motion=motion,
            images=images,
            times_s=None if frames.times_s is None else frames.times_s[kept],
            odometry="none" if frames.odometry is None else "measured",
        )

    def _frames(self, split: Split, folder: Path, paths: list[Path], key: str, notes: list[str]) -> _Frames:
        """Poses, odometry and times of the images of a drive."""
        self._tables(folder, key, split)
        names = [path.name for path in paths]
        times = self._times(folder, paths, key)
        if times is not None:
            check_rising(times, names, key)
            if split != "map" and self.max_gap_s is not None:
                check_gaps(times, names, self.max_gap_s, key)
        poses, own = self._trajectory(_only(folder, self.pose_file, "pose_file"), folder, paths, times, key, notes)
        odometry = None
        if self.odometry is not None and split != "map":
            odometry = self._odometry(_only(folder, self.odometry, "odometry"), folder, paths, times, key, notes)
        return _Frames(paths, poses, odometry, own if times is None else times)

    def _times(self, folder: Path, paths: list[Path], key: str) -> Float64[ndarray, "n"] | None:
        """Times of the images, from their names or a file; None if only the poses have times."""
        timed = self.poses in TIMED or (
            self.odometry is not None and is_timed(_only(folder, self.odometry, "odometry"))
        )
        if self.times == "order" or (self.times is None and not timed):
            return None
        if self.times not in ("names", None):
            return times_of_file(_only(folder, self.times, "times"), len(paths))
        times, names = times_of_names(paths), [path.name for path in paths]
        if times is None and (self.times == "names" or len(names_without_time(names)) < len(names)):
            raise ArgumentError(
                f"{key}: {'times=names, but ' if self.times else ''}{no_times(names)}",
                "Names such as 1305031102.175304.png, or times=order, or a file with one line per image.",
            )
        return times

    def _odometry(
        self,
        file: Path,
        folder: Path,
        paths: list[Path],
        times: Float64[ndarray, "n"] | None,
        key: str,
        notes: list[str],
    ) -> Float64[ndarray, "n 3"]:
        """Odometry of the camera at the images, of the format of the poses or of a table of odometry."""
        if not is_odometry_table(file):
            return self._trajectory(file, folder, paths, times, key, notes)[0]
        table = read_odometry(file)
        names = [path.name for path in paths]
        poses = table.poses
        if table.times_s is not None and times is not None:
            poses = poses_at(table.times_s, poses, times, names, self.max_gap_s, f"{key}, {file.name}")
        if len(poses) != len(paths):
            raise ArgumentError(
                f"{key}: {file.name} has {counted(len(poses), 'row')} for {counted(len(paths), 'image')}, {names[0]} "
                f"to {names[-1]}",
                "One row per image, in order; or a column time, and images whose names contain times.",
            )
        return compose(poses, np.repeat(self.mounting, len(poses), axis=0))

    def _trajectory(
        self,
        file: Path,
        folder: Path,
        paths: list[Path],
        times: Float64[ndarray, "n"] | None,
        key: str,
        notes: list[str],
    ) -> tuple[Float64[ndarray, "n 3"], Float64[ndarray, "n"] | None]:
        """Poses of the camera in the plane at the images, and the times that the file gives for them."""
        told: Float64[ndarray, "m"] | None = None
        if self.poses == "csv":
            poses = self._table(file, folder, paths, key)
        elif self.poses == "gps":
            poses = drive_by_gps(paths, self._of_map()[0], key, notes)
        elif self.poses == "kitti":
            poses = to_plane(read_kitti(file), self.plane, self.ahead, str(file))
        elif self.poses in NAMED_FORMATS:
            poses = self._named(file, folder, paths, key)
        else:
            form = next((each for each in RECORDED if each == self.poses), None)
            told, in_space = read_tum_matrices(file) if form is None else read_recorded(file, form)
            poses = to_plane(in_space, self.plane, self.ahead, str(file))
            if times is not None:
                names = [path.name for path in paths]
                poses, told = poses_at(told, poses, times, names, self.max_gap_s, f"{key}, {file.name}"), times
        if len(poses) != len(paths):
            raise ArgumentError(
                f"{key}: {file.name} has {counted(len(poses), 'pose')} for {counted(len(paths), 'image')}, "
                f"{paths[0].name} to {paths[-1].name}; without times they must be the same frames",
                "Remove unmatched images or poses, or give the times of TUM poses: times=names or a file.",
            )
        return compose(poses, np.repeat(self.mounting, len(poses), axis=0)), told

    def _table(self, file: Path, folder: Path, paths: list[Path], key: str) -> Float64[ndarray, "n 3"]:
        rows = table_poses(paths, folder, file, key)
        without = [path.name for path, row in zip(paths, rows, strict=True) if row.heading_deg is None]
        if without:
            raise ArgumentError(
                f"{key}: {file} has no column heading, which {counted(len(without), 'image needs', 'images need')}",
                "file,x,y,heading\nfirst.jpg,12.5,-3.0,90    (degrees counter-clockwise from x)",
            )
        return np.array([(row.x, row.y, np.radians(row.heading_deg or 0.0)) for row in rows])

    def _named(self, file: Path, folder: Path, paths: list[Path], key: str) -> Float64[ndarray, "n 3"]:
        assert self.poses in NAMED_FORMATS
        found = read_reconstruction(file, self.poses)
        names = [path.relative_to(folder.resolve()).as_posix() for path in paths]
        rows = found.match(names).refuse_ambiguous(f"{key}: {file}").rows
        if without := [name for name, row in zip(names, rows, strict=True) if row is None]:
            raise ArgumentError(
                f"{key}: {len(without):,} of {counted(len(names), 'image')} {'has' if len(without) == 1 else 'have'} "
                f"no pose in {file}\n{problem_list(without)}",
                "Move these images out of the folder, or estimate their poses with that program.",
            )
        poses = to_plane(found.poses, self.plane, self.ahead, str(file))
        return poses[[row for row in rows if row is not None]]

    def _once(self, poses: Float64[ndarray, "n 3"], paths: list[Path], key: str, notes: list[str]) -> ndarray:
        """The first image of each pose; others at exactly the same pose are an error, or left out with ``skip_bad``."""
        _, first, which = np.unique(poses, axis=0, return_index=True, return_inverse=True)
        double = np.flatnonzero(first[which.ravel()] != np.arange(len(poses)))
        named = [f"{paths[i].name} = {paths[first[which.ravel()[i]]].name}" for i in double.tolist()]
        if named and not self.skip_bad:
            raise ArgumentError(
                f"{key}: {len(named):,} of {counted(len(poses), 'image')} {'has' if len(named) == 1 else 'have'} the "
                f"same pose as another\n{problem_list(named)}",
                "Remove one of each (is a pose repeated for frames without one?), or skip them: skip_bad=true",
            )
        notes += [f"left out {name}" for name in named]
        return np.sort(first)


def _key(split: Split, name: str) -> str:
    """The argument that names the folder of a drive."""
    return split if split == "map" else f"{split}.{name.removeprefix('validation/')}"


def _only(folder: Path, name: str, argument: str) -> Path:
    """A file from a folder, which an argument names; with ``*`` in its name, the only one that matches."""
    found = sorted(folder.glob(name)) if "*" in name else []
    if len(found) > 1:
        raise ArgumentError(
            f"{folder / name} are {counted(len(found), 'file')}: {', '.join(each.name for each in found[:5])}",
            f"Name one: {argument}={found[0].relative_to(folder).as_posix()}",
        )
    return found[0] if found else folder / name
