"""Photos of known cameras, on which calibration is evaluated.

A folder is one of

- photos with a table, any ``.csv`` in it with the columns ``file`` and ``f_px`` (pixels of the file) and, where known,
  ``tilt_deg``, ``roll_deg``, ``k1`` and ``cluster`` (photos of the same cluster are not independent);
  ``f_sfm_px``, a focal length from structure from motion, takes precedence over ``f_px``; ``width`` and ``height``, if
  there, must be those of the file;
- level 2:1 panoramas with a table that has the column ``file`` but not ``f_px``, and optionally ``cluster``; photos are
  cut from them at evenly spaced headings, with cameras drawn from a distribution. A table of pictures that are not 2:1
  is ignored;
- photos of one chessboard camera with ``calibration_computed.json`` (OpenCV's K, dist);
- photos of one lens with ``K.txt``, a camera matrix of three rows;
- photos with focal lengths in their EXIF, and folders of any of these.
"""

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import partial
from itertools import zip_longest
from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8
from numpy import ndarray

from sextant.chapters.calibration.data.camera_distributions import CameraDistribution
from sextant.chapters.calibration.data.crops import crop_panoramas
from sextant.data.file_kinds import is_hidden
from sextant.data.name_matching import match_names
from sextant.data.photo_files import FOUND_IN_FOLDERS, find_photos, nothing_usable, walk_folder
from sextant.data.photos import read_photo
from sextant.data.picture_files import open_picture
from sextant.errors import UserError, problem_list
from sextant.user_files import absent, check_columns, read_table, read_text

UNKNOWN = math.nan
#: shorter side of photos cut from panoramas, pixels
CUT = 360
#: numeric columns of a table, with the smallest and the largest allowed value
COLUMNS = {
    "f_px": (1, 1_000_000),
    "f_sfm_px": (1, 1_000_000),
    "tilt_deg": (-90, 90),
    "roll_deg": (-180, 180),
    "k1": (-1000, 1000),
}


@dataclass(frozen=True, eq=False)
class KnownPhoto:
    """A photo and its camera, with nan for unknown parameters.

    Attributes:
        name: file name, or the panorama's with the number of the cut.
        cluster: photos of the same cluster are not independent.
        image: upright.
        tilt, roll: radians.
        focal: image heights.
        k1: first coefficient of distortion.
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
    skipped: dict[str, str] | None = None,
) -> Iterator[KnownPhoto]:
    """Yield the photos of a folder one by one; all tables are checked before the first photo is decoded.

    Args:
        folder: see the module.
        distribution: distribution of the cameras of photos cut from panoramas.
        cuts: photos cut from each panorama.
        seed: seed of these cameras.
        leave_out: patterns of file names to leave out, such as ``polyhaven__*``.
        skipped: receives the photos that cannot be read, with the reasons; they are left out.

    Raises:
        UserError: the folder or a table's file is missing, a table is broken, the folder has no photo of a known
            camera, or none can be read.
    """
    if not folder.is_dir():
        raise UserError(absent(folder), "Give a folder of photos of known cameras.")
    skipped = {} if skipped is None else skipped
    photos = _of_folder(folder, leave_out, lambda at, i, row: _cut(at, i, row, distribution, cuts, seed))
    found = False
    for path, read in photos:
        try:
            for photo in read():
                found = True
                yield photo
        except UserError as error:
            skipped[str(path)] = error.problem
    if found:
        return
    if skipped:
        raise nothing_usable(f"{folder}: none of its photos of known cameras can be read", skipped)
    find_photos(str(folder), None, "folder")
    raise UserError(
        f"{folder} has no photo of a known camera" + (" that is not left out" if leave_out else ""),
        "Put a table beside the photos, for example photos.csv with the columns file, f_px, tilt_deg and roll_deg.",
    )


Row = dict[str, str]
#: files, and functions that read the photos of each
Planned = list[tuple[Path, Callable[[], Iterator[KnownPhoto]]]]


@dataclass(frozen=True)
class _Table:
    """Rows by line number, each with a name in the column ``file`` if the table has it."""

    path: Path
    rows: dict[int, Row]
    columns: tuple[str, ...]

    def checked(self, there: Callable[[str], bool], panoramas: bool = False) -> list[Row]:
        """The rows that are not left out.

        Raises:
            UserError: a file is missing, listed twice or not a panorama, or a value is not allowed; the message names
                the lines.
        """
        rows = {line: row for line, row in self.rows.items() if there(row["file"])}
        if any(not (self.path.parent / row["file"]).is_file() for row in rows.values()):
            images = [path.as_posix() for path in walk_folder(self.path.parent).files]
            listed = list(rows.values())
            found = match_names(images, [row["file"] for row in listed]).refuse_ambiguous(str(self.path)).rows
            for image, index in zip(images, found, strict=True):
                if index is not None:
                    listed[index]["file"] = image
        seen: dict[Path, int] = {}
        problems: list[str] = []
        for line, row in rows.items():
            file = self.path.parent / row["file"]
            if file in seen:
                problems.append(f"line {line}: {row['file']} is already listed in line {seen[file]}")
            elif not file.is_file():
                problems.append(f"line {line}: {row['file']}: no such file in {self.path.parent}")
            elif panoramas and not _is_panorama(file, unread=True):
                problems.append(f"line {line}: {row['file']} is not a panorama: its sides are not 2:1")
            seen.setdefault(file, line)
            problems += [f"line {line}: {problem}" for problem in _wrong_values(row)]
        if problems:
            raise UserError(
                f"{self.path} cannot be used as it is\n{problem_list(problems)}",
                "Correct or remove these lines.",
            )
        return list(rows.values())


def _wrong_values(row: Row) -> Iterator[str]:
    for column, (least, most) in COLUMNS.items():
        value = row.get(column) or ""
        if not value and not (column == "f_px" and column in row and not row.get("f_sfm_px")):
            continue
        try:
            fits = least <= float(value) <= most
        except ValueError:
            fits = False
        if not fits:
            yield f"{column}={value} of {row['file']} must be a number from {least:,} to {most:,}"


def _of_folder(
    folder: Path, leave_out: Sequence[str], cut: Callable[[Path, int, Row], Iterator[KnownPhoto]]
) -> Planned:
    def there(name: str) -> bool:
        return not any(fnmatchcase(name, pattern) for pattern in leave_out)

    files = sorted(folder / path for path in walk_folder(folder, deep=False).files)
    found = [_table(path) for path in files if path.suffix.lower() == ".csv"]
    tables = [table for table in found if "file" in table.columns and table.rows]
    lenses = [table for table in tables if "f_px" in table.columns]
    own = [path for path in files if path.suffix.lower() in FOUND_IN_FOLDERS and there(path.name)]
    if lenses:
        return [(folder / row["file"], partial(_of_row, folder, row)) for row in lenses[0].checked(there)]
    panoramas = [each for each in tables if any(_is_panorama(folder / row["file"]) for row in each.rows.values())]
    if panoramas:
        rows = panoramas[0].checked(there, panoramas=True)
        return [(folder / row["file"], partial(cut, folder, i, row)) for i, row in enumerate(rows)]
    if (board := folder / "calibration_computed.json").is_file():
        focal, k1 = _numbers(board, lambda text: (json.loads(text)["K"][0][0], json.loads(text)["dist"][0]))
        return [(path, partial(_of_lens, path, focal, k1)) for path in own]
    if (matrix := folder / "K.txt").is_file():
        (focal,) = _numbers(matrix, lambda text: (text.split()[0],))
        return [(path, partial(_of_lens, path, focal)) for path in own]
    for table in tables:
        if told := [column for column in COLUMNS if column in table.columns]:
            raise UserError(
                f"{table.path} has a column {told[0]}, but no column f_px",
                "Add f_px, the focal length in pixels of the file.",
            )
    inside = sorted(path for path in folder.iterdir() if path.is_dir() and not is_hidden(path.name))
    planned: Planned = [(path, partial(_of_lens, path)) for path in own]
    return planned + [photo for each in inside for photo in _of_folder(each, leave_out, cut)]


def _table(path: Path) -> _Table:
    table = read_table(path, "Save it as CSV in UTF-8, or remove it.")
    if "file" not in table.header:
        return _Table(path, {}, table.header)
    check_columns(str(path), table.header, ("file", *COLUMNS))
    if problems := list(table.long_rows()):
        raise UserError(f"{path} cannot be used as it is\n{problem_list(problems)}", "Correct these lines.")
    rows = {
        line: dict(zip_longest(table.header, cells[: len(table.header)], fillvalue="")) for line, cells in table.rows
    }
    for line, row in rows.items():
        if not row["file"]:
            raise UserError(
                f"{path}: line {line} has no file", "Give the name of the photo's file, or remove the line."
            )
        for column in COLUMNS.keys() & row.keys():
            if "," in row[column] and (value := table.number(row[column])) is not None:
                row[column] = repr(value)
    return _Table(path, rows, table.header)


def _is_panorama(path: Path, unread: bool = False) -> bool:
    """Whether a picture is 2:1, by its header alone; ``unread`` if it cannot be read."""
    try:
        with open_picture(path) as image:
            return abs(image.width / image.height - 2) <= 0.01
    except OSError:
        return unread


def _numbers(path: Path, read: Callable[[str], tuple[str | float, ...]]) -> list[float]:
    try:
        found = [float(value) for value in read(read_text(path))]
        if not all(map(math.isfinite, found)) or found[0] <= 0:
            raise ValueError("the focal length is not above 0")
    except (OSError, ValueError, TypeError, LookupError) as error:
        problem = f"{path} has no focal length of a camera ({error or type(error).__name__})"
        raise UserError(
            problem, "K.txt needs a camera matrix of three rows, calibration_computed.json the keys K and dist."
        ) from None
    return found


def _of_row(folder: Path, row: Row) -> Iterator[KnownPhoto]:
    values = {key: float(row[key]) if row.get(key) else UNKNOWN for key in COLUMNS}
    photo = read_photo(folder / row["file"])
    stated = [row[side].removesuffix(".0") for side in ("width", "height") if row.get(side)]
    if len(stated) == 2 and sorted(stated) != sorted((str(photo.width), str(photo.height))):
        raise UserError(
            f"{row['file']} has {photo.width}x{photo.height} pixels, but its row says {'x'.join(stated)}",
            "Give f_px in pixels of the file, with its width and height, or without these columns.",
        )
    focal = values["f_px"] if math.isnan(values["f_sfm_px"]) else values["f_sfm_px"]
    cluster = row.get("cluster") or (f"{row.get('source_owner')} {row['model']}" if row.get("model") else row["file"])
    tilt, roll = math.radians(values["tilt_deg"]), math.radians(values["roll_deg"])
    yield KnownPhoto(row["file"], cluster, photo.image, tilt, roll, focal / photo.height, values["k1"])


def _of_lens(path: Path, focal: float | None = None, k1: float = UNKNOWN) -> Iterator[KnownPhoto]:
    """A photo in the cluster of its lens; the focal length is from EXIF where ``focal`` is None."""
    photo = read_photo(path)
    if known := photo.exif_focal_px if focal is None else focal:
        lens = f"{path.parent} f={known / max(photo.width, photo.height):.3f}"
        yield KnownPhoto(path.name, lens, photo.image, UNKNOWN, UNKNOWN, known / photo.height, k1)


def _cut(
    folder: Path, i: int, row: Row, distribution: CameraDistribution, cuts: int, seed: int
) -> Iterator[KnownPhoto]:
    file = row["file"]
    panorama = read_photo(folder / file).image
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
