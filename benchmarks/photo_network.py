"""A calibration network on images that it was not trained on: ``python -m benchmarks.photo_network run=<run>``.

Medians of the network alone, without lines, and the coverage of its 68 and 95 % intervals for tilt, roll and field of
view. Photos and their tables are those of ``SEXTANT_DATA``; panoramas are those held out from training of the package's
weights. Last, the change in the estimated field of view of every third photo of York Urban when it is blurred.
"""

import csv
import math
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import torch

from sextant.chapters.calibration.data.batches import Crops
from sextant.chapters.calibration.data.datamodule import TEST
from sextant.chapters.calibration.data.panorama_folder import decode_panorama
from sextant.chapters.calibration.data.panoramas import Panoramas
from sextant.chapters.calibration.metrics.errors import calibration_errors
from sextant.chapters.calibration.network import CalibrationPrediction, CameraNetwork, reported, trained_camera_network
from sextant.composing.compose import compose, to_plain
from sextant.config.building import build
from sextant.console.arguments import parse_arguments
from sextant.data.photos import Photo, network_view, read_photo
from sextant.geometry import CameraParameters
from sextant.kit.trained import read_trained
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.resolve import resolve_run

KEYS = {"run": "a run of calibration: zoo:calibration, a directory or a checkpoint"}
PHOTOS = ("york_urban", "phone_gravity", "exif_focal")
BOARDS = "camera_boards/opencv_left"
CROPS = 7  # per panorama
NOT_FOR_TRAINING = ("zind", "jameskuk")  # scenes of their own; the other panoramas are one set
BLURRED = (168, 120, 84, 60, 42)  # lines of the photo's height


def truths(data: Path, source: str) -> dict[Path, dict[str, float]]:
    """The known parameters of each photo of a source."""
    if source == BOARDS:
        return {path: {"f_px": 532.5} for path in sorted((data / source).glob("*.jpg"))}
    with open(data / source / f"{source}.csv", newline="") as table:
        rows = list(csv.DictReader(table))
    found = {}
    for row in rows:  # structure from motion takes precedence over EXIF, as in sextant benchmark
        row["f_px"] = row.get("f_sfm_px") or row["f_px"]
        known = {key: float(row[key]) for key in ("f_px", "tilt_deg", "roll_deg") if row.get(key)}
        found[data / source / row["file"]] = known
    return found


def asked(network: CameraNetwork, photos: list[Photo]) -> tuple[CalibrationPrediction, torch.Tensor, torch.Tensor]:
    """The network's predictions for photos, and the aspect and height in pixels of its input for each."""
    spec = network.spec
    views = [network_view(photo, spec.aspects, spec.width, spec.height, canvas=spec.canvas) for photo in photos]
    images = torch.from_numpy(np.stack([view.image for view in views]).transpose(0, 3, 1, 2).copy())
    aspect = torch.tensor([view.aspect for view in views])
    return network.predict(images, aspect), aspect, torch.tensor([view.height for view in views])


def row(name: str, error: torch.Tensor, said: CalibrationPrediction, focal: torch.Tensor, rays: float) -> str:
    """A line of the table, from errors of tilt, roll and vfov (radians) and relative ones of the focal length."""
    medians = np.degrees(np.median(error.numpy(), axis=0)).tolist()  # nan where there is no truth
    held = []
    for level in (0.68, 0.95):
        inside = (error <= (said.scale * said.quantile(level))[:, :3]).float()
        held.append(torch.where(error.isnan(), torch.nan, inside).nanmean(0).tolist())
    cells = [*(f"{value:.1f}" for value in (rays, *medians)), f"{100 * np.median(focal.abs().numpy()):.0f} %"]
    cells += ["/".join(f"{100 * share:.0f}" for share in shares) for shares in held]
    return f"| {name} | {len(error)} | " + " | ".join(cell.replace("nan", "") for cell in cells)


def photo_row(network: CameraNetwork, data: Path, source: str) -> str:
    known = truths(data, source)
    said, _, height = asked(network, [read_photo(path) for path in known])
    focal = torch.tensor([each["f_px"] for each in known.values()]) / height
    angles = [[each.get(key, math.nan) for each in known.values()] for key in ("tilt_deg", "roll_deg")]
    tilt, roll = torch.deg2rad(torch.tensor(angles))
    truth = CameraParameters(tilt, roll, focal, torch.zeros_like(focal))
    error = (reported(said.parameters) - reported(truth))[:, :3]
    error[:, 1] = torch.remainder(error[:, 1] + math.pi, 2 * math.pi) - math.pi
    return row(source, error.abs(), said, said.parameters.focal / focal - 1, math.nan)


def panorama_sets(data: Path) -> dict[str, list[Path]]:
    """Panoramas that shipped weights are not trained on, by scene."""
    with open(data / "panoramas_more/licences.csv", newline="") as table:
        allowed = {entry["file"] for entry in csv.DictReader(table) if entry["ok_for_MIT_weights"] == "yes"}
    found: dict[str, list[Path]] = {name: [] for name in (*NOT_FOR_TRAINING, "others")}
    for path in sorted([*(data / "panoramas").glob("*.jpg"), *(data / "panoramas_more").glob("*.jpg")]):
        prefix = path.name.partition("__")[0]
        if prefix != "polyhaven" and path.name not in allowed:
            found[prefix if prefix in found else "others"].append(path)
    return found


def panorama_row(network: CameraNetwork, name: str, paths: list[Path], sampling: str) -> str:
    held = Panoramas([decode_panorama(path, 512) for path in paths], [path.name for path in paths])
    distribution = build(to_plain(compose(["task=calibration", f"sampling={sampling}"])), "sampling")
    crops = Crops(held, distribution, network.spec.width, network.spec.height, TEST, canvas=network.spec.canvas)
    batch = crops[list(range(CROPS * len(held)))]
    said = network.predict(batch.images, batch.aspect)
    found, truth = (camera.to(dtype=torch.float64) for camera in (said.parameters, batch.cameras))
    rays = calibration_errors(found, truth, batch.aspect.double(), k2_of_k1="lopez")["bearing_deg"]
    error = (reported(said.parameters) - reported(batch.cameras))[:, :3].abs()
    return row(
        f"{name}, {sampling}", error, said, said.parameters.focal / batch.cameras.focal - 1, float(np.median(rays))
    )


def blur_rows(network: CameraNetwork, data: Path) -> Iterator[str]:
    """The change in the field of view by the number of lines to which a photo is reduced."""
    photos = [read_photo(path) for path in list(truths(data, "york_urban"))[::3]]

    def fields(lines: int | None) -> torch.Tensor:
        shown = photos if lines is None else [blurred(photo, lines) for photo in photos]
        return torch.rad2deg(reported(asked(network, shown)[0].parameters)[:, 2])

    sharp = fields(None)
    for lines in BLURRED:
        soft = fields(lines)
        moved = (soft - sharp).abs()
        cells = [float(np.median(value)) for value in (sharp, soft, moved)]
        yield f"| {lines} | " + " | ".join(f"{value:.1f}" for value in (*cells, float(moved.max()))) + " |"


def blurred(photo: Photo, lines: int) -> Photo:
    """A photo reduced to ``lines`` rows and enlarged to its original height."""
    rows, columns = photo.image.shape[:2]
    small = cv2.resize(photo.image, (round(columns * lines / rows), lines), interpolation=cv2.INTER_AREA)
    return Photo(cv2.resize(small, (columns, rows), interpolation=cv2.INTER_CUBIC), photo.width, photo.height, 1, None)


def main() -> None:
    given = parse_arguments(sys.argv[1:], KEYS, "python -m benchmarks.photo_network run=zoo:calibration")
    path = resolve_run(given["run"], default_outputs()).checkpoint
    network, data = trained_camera_network(read_trained(path), path), Path(os.environ["SEXTANT_DATA"])
    print("| set | images | rays | tilt | roll | vfov | focal | 68 % holds tilt/roll/vfov | 95 % holds |")
    print("|" + "---|" * 9)
    for source in (*PHOTOS, BOARDS):
        print(photo_row(network, data, source) + " |")
    for name, paths in panorama_sets(data).items():
        for sampling in ("lopez_4x3", "held_cameras"):
            print(panorama_row(network, name, paths, sampling) + " |")
    print("\n| lines left | vfov of the sharp photo | blurred | median move | largest |\n|" + "---|" * 5)
    print("\n".join(blur_rows(network, data)))


if __name__ == "__main__":
    main()
