"""Photos of known cameras: what a calibration is measured on.

A folder is one of

- photos with a table, any ``.csv`` in it with the columns ``file`` and ``f_px`` (pixels of the file), and as far as
  they are known ``tilt_deg``, ``roll_deg``, ``k1`` and ``cluster`` (photos of one are not independent);
  ``f_sfm_px``, a focal length by structure from motion, goes before ``f_px``;
- panoramas with a table, the column ``file`` without ``f_px``: 2:1, level; photos of cameras that a distribution draws
  are cut from them, evenly around;
- photos of one chessboard camera with ``calibration_computed.json`` (OpenCV's K, dist);
- photos of one lens with ``K.txt``, a camera matrix of three rows;
- photos with focal lengths in their EXIF;
- folders of these.
"""

import csv
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8
from numpy import ndarray

from sextant.data.calibration.camera_distributions import CameraDistribution
from sextant.data.calibration.crops import crop_panoramas
from sextant.data.photo_files import find_photos
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
    folder: Path, distribution: CameraDistribution, *, cuts: int = 7, seed: int = 0
) -> Iterator[KnownPhoto]:
    """The photos of a folder, one after the other.

    Args:
        folder: see the module.
        distribution: of the cameras of photos cut from panoramas.
        cuts: photos that are cut from each panorama.
        seed: of these cameras.

    Raises:
        UserError: the folder or a file of it is missing, or it has no photo of a known camera.
    """
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder", "Give a folder of photos of known cameras.")
    found = _of_folder(folder, distribution, cuts, seed)
    first = next(found, None)
    if first is None:
        raise UserError(
            f"{folder} has no photo of a known camera",
            "Put a table beside the photos, for example photos.csv with the columns file, f_px, tilt_deg and roll_deg.",
        )
    yield first
    yield from found


def _of_folder(folder: Path, distribution: CameraDistribution, cuts: int, seed: int) -> Iterator[KnownPhoto]:
    tables = [rows for path in sorted(folder.glob("*.csv")) if "file" in (rows := _rows(path))[0]]
    lenses = [rows for rows in tables if "f_px" in rows[0]]
    if lenses:
        yield from (_of_row(folder, row) for row in lenses[0])
    elif tables:
        yield from _cut(folder, [row["file"] for row in tables[0]], distribution, cuts, seed)
    elif (board := folder / "calibration_computed.json").is_file():
        camera = json.loads(board.read_text())
        yield from _of_lens(folder, float(camera["K"][0][0]), float(camera["dist"][0]))
    elif (matrix := folder / "K.txt").is_file():
        yield from _of_lens(folder, float(matrix.read_text().split()[0]), UNKNOWN)
    elif inside := sorted(path for path in folder.iterdir() if path.is_dir()):
        for each in inside:
            yield from _of_folder(each, distribution, cuts, seed)
    else:
        yield from _of_lens(folder, None, UNKNOWN)


def _rows(path: Path) -> list[dict[str, str]]:
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file)) or [{}]


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


def _of_lens(folder: Path, focal: float | None, k1: float) -> Iterator[KnownPhoto]:
    """Photos of one lens; by EXIF where ``focal`` is None."""
    for path in find_photos(str(folder), folder / "found"):
        photo = read_photo(path)
        known = photo.exif_focal_px if focal is None else focal
        if known:
            yield KnownPhoto(path.name, path.name, photo.image, UNKNOWN, UNKNOWN, known / photo.height, k1)


def _cut(
    folder: Path, files: list[str], distribution: CameraDistribution, cuts: int, seed: int
) -> Iterator[KnownPhoto]:
    for i, file in enumerate(files):
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
            yield KnownPhoto(f"{file}#{j}", file, image, *(float(value[0]) for value in camera))
