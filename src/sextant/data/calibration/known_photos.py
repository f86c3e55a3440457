"""Photos of known cameras: what a calibration is measured on.

A folder is one of

- photos with a table, any ``.csv`` in it with the columns ``file`` and ``f_px`` (pixels of the file), and as far as
  they are known ``tilt_deg``, ``roll_deg``, ``k1`` and ``cluster`` (photos of one are not independent);
  ``f_sfm_px``, a focal length by structure from motion, goes before ``f_px``;
- panoramas with a table, the column ``file`` without ``f_px``, and ``cluster``: 2:1, level; photos of cameras that a
  distribution draws are cut from them, evenly around. A table of pictures that are not 2:1 is of something else;
- photos of one chessboard camera with ``calibration_computed.json`` (OpenCV's K, dist);
- photos of one lens with ``K.txt``, a camera matrix of three rows;
- photos with focal lengths in their EXIF, and folders of all these.
"""

import csv
import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from sextant.data.calibration.camera_distributions import CameraDistribution
from sextant.data.calibration.crops import crop_panoramas
from sextant.data.photo_files import FOUND_IN_FOLDERS, find_photos
from sextant.data.photos import read_photo
from sextant.errors import UserError

UNKNOWN = math.nan
#: shorter side of photos cut from panoramas, pixels
CUT = 360


@dataclass(frozen=True, eq=False)
class KnownPhoto:
    """A photo and its camera; nan for what is not known of it.

    Attributes:
        name: of the file, or of the panorama and the number of the cut.
        cluster: photos of one are not independent.
        image: upright.
        tilt, roll: radians.
        focal: image heights.
        k1: of the camera's distortion.
    """

    name: str
    cluster: str
    image: UInt8[ndarray, "h w 3"]
    tilt: float
    roll: float
    focal: float
    k1: float


def known_photos(
    folder: Path,
    distribution: CameraDistribution,
    *,
    cuts: int = 7,
    seed: int = 0,
    leave_out: Sequence[str] = (),
) -> Iterator[KnownPhoto]:
    """The photos of a folder, one after the other.

    Args:
        folder: see the module.
        distribution: of the cameras of photos cut from panoramas.
        cuts: photos that are cut from each panorama.
        seed: of these cameras.
        leave_out: patterns of the names of files that are left out, such as ``polyhaven__*``.

    Raises:
        UserError: the folder or a file of it is missing or broken, or it has no photo of a known camera.
    """
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder", "Give a folder of photos of known cameras.")
    found = _of_folder(folder, leave_out, lambda of, rows: _cut(of, rows, distribution, cuts, seed))
    first = next(found, None)
    if first is None:
        find_photos(str(folder), None, "folder")
        raise UserError(
            f"{folder} has no photo of a known camera" + (" that is not left out" if leave_out else ""),
            "Put a table beside the photos, for example photos.csv with the columns file, f_px, tilt_deg and roll_deg.",
        )
    yield first
    yield from found


Row = dict[str, str]


def _of_folder(
    folder: Path, leave_out: Sequence[str], cut: Callable[[Path, list[Row]], Iterator[KnownPhoto]]
) -> Iterator[KnownPhoto]:
    def there(name: str) -> bool:
        return not any(fnmatchcase(name, pattern) for pattern in leave_out)

    tables = [rows for path in sorted(folder.glob("*.csv")) if "file" in (rows := _rows(path))[0]]
    lenses = [rows for rows in tables if "f_px" in rows[0]]
    panoramas = [rows for rows in tables if _is_panorama(folder / rows[0]["file"])]
    own = [path for path in sorted(folder.iterdir()) if path.suffix.lower() in FOUND_IN_FOLDERS and there(path.name)]
    if lenses:
        yield from (_of_row(folder, row) for row in lenses[0] if there(row["file"]))
    elif panoramas:
        yield from cut(folder, [row for row in panoramas[0] if there(row["file"])])
    elif (board := folder / "calibration_computed.json").is_file():
        yield from _of_lens(
            own, *_numbers(board, lambda text: (json.loads(text)["K"][0][0], json.loads(text)["dist"][0]))
        )
    elif (matrix := folder / "K.txt").is_file():
        yield from _of_lens(own, *_numbers(matrix, lambda text: (text.split()[0],)))
    else:
        yield from _of_lens(own)
        for inside in sorted(path for path in folder.iterdir() if path.is_dir()):
            yield from _of_folder(inside, leave_out, cut)


def _rows(path: Path) -> list[Row]:
    """Of a table, each with a name in the column ``file`` if there is one."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
    except (UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{path} is no table in UTF-8 ({error})", "Save it as CSV in UTF-8, or take it away.") from None
    for i, row in enumerate(rows, start=2):
        if "file" in row and not row["file"]:
            raise UserError(f"{path}: line {i} has no file", "Give the name of the photo's file, or take the line out.")
    return rows or [{}]


def _is_panorama(path: Path) -> bool:
    """Whether a picture is 2:1, by its header alone."""
    try:
        with Image.open(path) as image:
            return abs(image.width / image.height - 2) <= 0.01
    except OSError:
        return False


def _numbers(path: Path, read: Callable[[str], tuple[str | float, ...]]) -> list[float]:
    try:
        found = [float(value) for value in read(path.read_text(encoding="utf-8-sig"))]
        if not all(map(math.isfinite, found)) or found[0] <= 0:
            raise ValueError("the focal length is not above 0")
    except (ValueError, TypeError, LookupError) as error:
        problem = f"{path} has no focal length of a camera ({error or type(error).__name__})"
        raise UserError(
            problem, "K.txt has a camera matrix of three rows; calibration_computed.json K and dist."
        ) from None
    return found


def _of_row(folder: Path, row: dict[str, str]) -> KnownPhoto:
    try:
        values = {
            key: float(row[key]) if row.get(key) else UNKNOWN
            for key in ("f_px", "f_sfm_px", "tilt_deg", "roll_deg", "k1")
        }
    except ValueError as error:
        raise UserError(f"{folder}: the row of {row['file']} has a value that is no number ({error})") from None
    photo = read_photo(folder / row["file"])
    focal = values["f_px"] if math.isnan(values["f_sfm_px"]) else values["f_sfm_px"]
    cluster = row.get("cluster") or (f"{row.get('source_owner')} {row['model']}" if row.get("model") else row["file"])
    tilt, roll = math.radians(values["tilt_deg"]), math.radians(values["roll_deg"])
    return KnownPhoto(row["file"], cluster, photo.image, tilt, roll, focal / photo.height, values["k1"])


def _of_lens(photos: Sequence[Path], focal: float | None = None, k1: float = UNKNOWN) -> Iterator[KnownPhoto]:
    """Photos of one lens, which are not independent; each by its EXIF where ``focal`` is None."""
    for path in photos:
        photo = read_photo(path)
        if known := photo.exif_focal_px if focal is None else focal:
            lens = f"{path.parent} f={known / max(photo.width, photo.height):.3f}"
            yield KnownPhoto(path.name, lens, photo.image, UNKNOWN, UNKNOWN, known / photo.height, k1)


def _cut(folder: Path, rows: list[Row], distribution: CameraDistribution, cuts: int, seed: int) -> Iterator[KnownPhoto]:
    for i, row in enumerate(rows):
        file = row["file"]
        panorama = read_photo(folder / file).image
        if not _is_panorama(folder / file):
            raise UserError(f"{folder / file} is no panorama: its sides are not 2:1", "Take it out of the table.")
        draw = distribution.draw_for(np.full(cuts, i), np.arange(cuts), seed)
        around = draw.yaw[0] + torch.arange(cuts, dtype=torch.float64) * 2 * math.pi / cuts
        yaw = torch.remainder(around + math.pi, 2 * math.pi) - math.pi
        for j in range(cuts):
            camera, aspect = draw.cameras.at(torch.tensor([j])), float(draw.aspect[j])
            width, height = (round(CUT * max(side, 1.0)) for side in (aspect, 1 / aspect))
            (crop,) = crop_panoramas(
                panorama, camera, yaw[j : j + 1], width, height, aspect=draw.aspect[j : j + 1],
                k2_of_k1=distribution.k2_of_k1,
            )  # fmt: skip
            image = np.ascontiguousarray(np.asarray(crop).transpose(1, 2, 0))
            yield KnownPhoto(f"{file}#{j}", row.get("cluster") or file, image, *(float(value[0]) for value in camera))
