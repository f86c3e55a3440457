"""Photos with six-dimensional poses and cameras, from the files of several programs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.applications.pixels import as_pixels
from sextant.chapters.localization.data.pose_formats import (
    LENGTH_TOLERANCE,
    pose_matrices,
    read_kitti,
    read_tum_matrices,
)
from sextant.correspondence import Pinhole
from sextant.data.image_files import natural_key, require_sides
from sextant.data.name_matching import match_names
from sextant.data.photo_files import images_below
from sextant.data.picture_files import open_picture, why_unreadable
from sextant.data.pixel_values import warn_once
from sextant.data.positions import too_far
from sextant.data.reconstructions.reading import named_format, read_reconstruction
from sextant.data.upright import upright_size
from sextant.errors import UserError, problem_list
from sextant.tables import counted
from sextant.user_files import absent, check_columns, read_table

#: files of named images, the first that exists is read; then files whose rows are in the order of the photos
NAMED = (
    *("poses.csv", "images.bin", "images.txt", "sparse/0/images.bin", "sparse/0/images.txt", "sparse/images.bin"),
    *("sparse/images.txt", "transforms.json", "reconstruction.json"),
)
ORDERED = ("poses.tum", "trajectory.tum", "groundtruth.txt", "poses.txt")
COLUMNS = ("file", "x", "y", "z", "qw", "qx", "qy", "qz")
CAMERA_COLUMNS = ("fx", "fy", "cx", "cy")
FIX = (
    "Put one of these beside the photos: poses.csv (file,x,y,z,qw,qx,qy,qz and, if known, fx,fy,cx,cy), a model of "
    "COLMAP, transforms.json (nerfstudio), reconstruction.json (OpenSfM), poses.tum or poses.txt (KITTI)."
)


@dataclass(frozen=True)
class PhotoLens:
    """The camera of a photo.

    Attributes:
        width, height: of the images that it was calibrated with; 0 if unknown.
        opencv: fx, fy, cx, cy, k1, k2, p1, p2 of OpenCV, pixels of these images.
    """

    width: int
    height: int
    opencv: tuple[float, ...]

    def of_size(self, width: int, height: int, what: str) -> "PhotoLens":
        """The camera for an image of another size.

        Raises:
            UserError: the image has another shape.
        """
        if (width, height) == (self.width, self.height) or not self.width:
            return PhotoLens(width, height, self.opencv)
        scale = width / self.width
        if abs(self.height * scale - height) > max(2.0, 0.01 * height):
            turned = abs(width / self.height - height / self.width) < 0.01
            raise UserError(
                f"{what} has {width}x{height} pixels, but its camera is of {self.width}x{self.height}"
                + (": EXIF turns it upright, but its pose is of the stored pixels" if turned else ""),
                "Remove the orientation from EXIF (exiftool -Orientation= <file>)."
                if turned
                else "Use the same images.",
            )
        fx, fy, cx, cy, *bent = self.opencv
        centre = ((cx + 0.5) * scale - 0.5, (cy + 0.5) * scale - 0.5)
        return PhotoLens(width, height, (fx * scale, fy * scale, *centre, *bent))


@dataclass(frozen=True, eq=False)
class PosedPhotos:
    """Photos of a map.

    Attributes:
        paths: files of the photos.
        poses: ``world_from_camera`` of each.
        cameras: of each; None: none is known.
        source: the file of the poses.
    """

    paths: Sequence[Path]
    poses: Float64[ndarray, "n 4 4"]
    cameras: Sequence["PhotoLens"] | None
    source: Path


class StraightPhotos(Sequence[ndarray]):
    """Photos as arrays without their lenses' distortion, decoded one by one.

    Args:
        photos: with cameras.

    Raises:
        UserError: a photo is not of the size, or at least the shape, of its camera's images; or, also when it is
            decoded, cannot be read.
    """

    def __init__(self, photos: PosedPhotos):
        self._paths = photos.paths
        both = zip(photos.cameras or (), photos.paths, strict=True)
        self._lenses = [lens.of_size(*_size(path), str(path)) for lens, path in both]

    @property
    def cameras(self) -> list[Pinhole]:
        """The cameras of the pictures."""
        return [Pinhole(lens.width, lens.height, *lens.opencv[:4]) for lens in self._lenses]

    def __len__(self) -> int:
        return len(self._paths)

    def __getitem__(self, index: Any) -> Any:
        lens = self._lenses[index]
        pixels = as_pixels(self._paths[index], (lens.height, lens.width, 3))
        fx, fy, cx, cy, *bent = lens.opencv
        if not any(bent):
            return pixels
        import cv2

        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        return np.asarray(cv2.undistort(pixels, matrix, np.array(bent)))


def _size(photo: Path) -> tuple[int, int]:
    """Width and height, upright, by its header alone."""
    try:
        with open_picture(photo) as image:
            require_sides(image)
            return upright_size(image)
    except Exception as error:  # Pillow raises errors of any kind for a file that is no picture
        raise UserError(f"{photo}: {why_unreadable(photo, error)}", "Replace the file, or leave it out.") from None


def posed_photos(folder: Path | str) -> PosedPhotos:
    """Read the photos below a folder that have poses in one of the files of :data:`NAMED` or :data:`ORDERED`.

    Photos without one are left out, with a warning.

    Raises:
        UserError: the folder or such a file is missing, the file cannot be read, or it has poses of other photos.
    """
    folder = Path(folder).expanduser()
    if not folder.is_dir():
        raise UserError(f"map={absent(folder)}", "Give a folder of photos with poses, or a saved map of posed photos.")
    photos = sorted(images_below(folder), key=lambda path: natural_key(path.relative_to(folder).as_posix()))
    if not photos:
        raise UserError(f"map={folder}: no photo there", FIX)
    for name in (*NAMED, *ORDERED):
        if (folder / name).is_file():
            named = name in NAMED
            return _of_names(folder, folder / name, photos) if named else _in_order(folder / name, photos)
    raise UserError(f"map={folder}: no file of poses there", FIX)


def _in_order(source: Path, photos: Sequence[Path]) -> PosedPhotos:
    poses = read_kitti(source) if source.name == "poses.txt" else read_tum_matrices(source)[1]
    if len(poses) != len(photos):
        raise UserError(
            f"{source} has {counted(len(poses), 'pose')} for {counted(len(photos), 'photo')}",
            "One pose for each photo, in the order of their names; or name the photos: poses.csv.",
        )
    return PosedPhotos(photos, poses, None, source)


def _of_names(folder: Path, source: Path, photos: Sequence[Path]) -> PosedPhotos:
    names, poses, cameras = read_posed_table(source) if source.suffix == ".csv" else _reconstruction(source)
    found = match_names([path.relative_to(folder).as_posix() for path in photos], names)
    rows = found.refuse_ambiguous(f"map={source}").rows
    kept = [(path, row) for path, row in zip(photos, rows, strict=True) if row is not None]
    if not kept:
        raise UserError(
            f"{source} has poses of {counted(len(names), 'image')}, but of none of the photos below {folder}", FIX
        )
    if without := [path.relative_to(folder).as_posix() for path, row in zip(photos, rows, strict=True) if row is None]:
        warn_once(f"{source}: {_examples(without, 'photo')} left out: without a pose")
    used = {*rows}
    if source.suffix == ".csv" and (absent_ones := [name for row, name in enumerate(names) if row not in used]):
        warn_once(f"{source}: {_examples(absent_ones, 'row')} left out: no such photo below {folder}")
    numbers = [row for _, row in kept]
    chosen = None if cameras is None else [cameras[row] for row in numbers]
    wrong = [
        f"{names[row]}: focal lengths of {cameras[row].opencv[0]:g} and {cameras[row].opencv[1]:g} pixels"
        for row in numbers
        if cameras is not None and min(cameras[row].opencv[:2]) <= 0
    ]
    if wrong:
        fix = "Focal lengths are above 0. Where the cameras are not known, leave them out."
        raise UserError(f"{source}: {counted(len(wrong), 'camera')} cannot be used\n{problem_list(wrong)}", fix)
    return PosedPhotos([path for path, _ in kept], poses[numbers], chosen, source)


def _examples(names: Sequence[str], noun: str) -> str:
    """How many there are, and the first."""
    return f"{counted(len(names), noun)} ({names[0]}{', ...' if len(names) > 1 else ''})"


def _reconstruction(source: Path) -> tuple[list[str], ndarray, list[PhotoLens] | None]:
    kind = named_format(source)
    if kind is None:
        raise UserError(f"{source} is not a file of poses", FIX)
    found = read_reconstruction(source, kind)
    models = {each.lens.model for each in found.images if each.lens is not None and each.lens.opencv is None}
    if models:
        raise UserError(
            f"{source}: the camera model {min(models)} is not supported here",
            "Undistort the images first (colmap image_undistorter), or use PINHOLE, SIMPLE_RADIAL, RADIAL or OPENCV.",
        )
    lenses = [each.lens for each in found.images]
    if any(lens is None for lens in lenses):
        return found.names, found.poses, None
    cameras = [PhotoLens(lens.width, lens.height, lens.opencv or ()) for lens in lenses if lens is not None]
    return found.names, found.poses, cameras


def read_posed_table(source: Path, *, unlocated: bool = False) -> tuple[list[str], ndarray, list[PhotoLens] | None]:
    """Names, poses ``world_from_camera`` and cameras, if there are any, of a table ``file,x,y,z,qw,qx,qy,qz``.

    Args:
        source: the table.
        unlocated: pass over rows without any number of a pose, which ``sextant locate`` writes of images not found,
            and over cameras.

    Raises:
        UserError: a column is missing or there twice, or a row cannot be used.
    """
    table = read_table(source, FIX)
    check_columns(str(source), table.header, COLUMNS if unlocated else (*COLUMNS, *CAMERA_COLUMNS))
    missing = [name for name in COLUMNS if name not in table.header]
    if missing:
        raise UserError(f"{source} has no column {', '.join(missing)}", FIX)
    given = [name for name in CAMERA_COLUMNS if name in table.header and not unlocated]
    if given and len(given) < len(CAMERA_COLUMNS):
        raise UserError(
            f"{source}: of the camera's columns {','.join(CAMERA_COLUMNS)} only {','.join(given)} are there",
            "Give all four, or none of them: the focal length is then estimated.",
        )
    whole = [(line, cells) for line, cells in table.rows if len(cells) >= len(table.header)]
    without = [line for line, cells in whole if not any(cells[table.header.index(name)] for name in given)]
    if given and len(without) == len(whole):
        given = []
    elif given and without:
        raise UserError(
            f"{source}: the camera {','.join(CAMERA_COLUMNS)} is missing in {counted(len(without), 'row')} of "
            f"{len(table.rows):,}, such as line {without[0]}",
            "Give it in all rows, or in none: the focal length is then estimated.",
        )
    wanted = [*COLUMNS[1:], *given]
    place, columns = table.header.index("file"), [table.header.index(name) for name in wanted]
    names, rows, problems = [], [], []
    for line, cells in table.rows:
        if len(cells) < len(table.header) or any(cells[len(table.header) :]):
            problems.append(f"line {line}: {counted(len(cells), 'value')} for {counted(len(table.header), 'column')}")
            continue
        row = [table.number(cells[column]) for column in columns]
        if unlocated and not any(cells[column] for column in columns[:7]):
            continue
        if None in row:
            at = row.index(None)
            problems.append(f"line {line}: {wanted[at]} is {cells[columns[at]] or 'empty'}, not a finite number")
        elif abs((length := math.hypot(*row[3:7])) - 1) > LENGTH_TOLERANCE:  # type: ignore[arg-type]
            problems.append(f"line {line}: the quaternion qw,qx,qy,qz has length {length:.3g}, not 1")
        elif far := too_far(row[:3]):  # type: ignore[arg-type]
            problems.append(f"line {line}: {far}")
        else:
            names.append(cells[place])
            rows.append(row)
    if problems or not rows:
        what = f"{counted(len(problems), 'row')} cannot be used" if problems else "there are no rows"
        raise UserError(f"{source}: {what}\n{problem_list(problems)}".rstrip(), FIX)
    values = np.array(rows, np.float64)
    quaternions = values[:, [4, 5, 6, 3]] / np.linalg.norm(values[:, 3:7], axis=1, keepdims=True)
    cameras = [PhotoLens(0, 0, (*row[7:11], 0.0, 0.0, 0.0, 0.0)) for row in values.tolist()]
    return names, pose_matrices(values[:, :3], quaternions), cameras if len(wanted) > 7 else None
