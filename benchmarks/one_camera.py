"""One camera from several photos with and without their matches: ``python -m benchmarks.one_camera``.

Groups of consecutive photos, spread over each set of one lens; the sets of :mod:`benchmarks.shared_focal`, and street
photos by EXIF, chessboards and York Urban, whose photos show hardly one still scene. With ``zoom=1.3`` the latter half
of each group is magnified by that factor, which a zoom would do: how often is it noticed, and how wrong is the answer?
Intervals of shares are 95 % by Clopper and Pearson over groups, which overlap. One thread.
"""

import math
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from numpy import ndarray
from PIL import Image

from benchmarks.machine import describe_machine
from benchmarks.shared_focal import clopper, sets
from sextant.applications import PhotoCalibrator
from sextant.chapters.calibration.confidence import photo_camera
from sextant.chapters.calibration.finding import Finding
from sextant.chapters.calibration.inference import find_cameras
from sextant.chapters.calibration.jointly import by_method
from sextant.chapters.calibration.matched_focal import PhotoMatches
from sextant.chapters.calibration.one_camera import fuse_as_one_camera
from sextant.console.arguments import parse_arguments
from sextant.correspondence import LocalFeatures, XFeatures, detected
from sextant.data.photos import read_photo
from sextant.errors import UserError

KEYS = {
    "sets": "beginnings of names of sets, separated by commas (default: all)",
    "groups": "groups of each size (default: 4)",
    "sizes": "photos of a group, separated by commas (default: 6,10)",
    "zoom": "magnification of the latter half of each group (default: 1)",
}


def lenses(data: Path) -> dict[str, tuple[list[Path], float]]:
    """Photos in order, and their focal length in pixels."""
    found = sets(data)
    street = sorted((data / "photos/lund").glob("*.[jJ]*"))
    found["street"] = street, float(read_photo(street[0]).exif_focal_px or np.nan)
    found["chessboards"] = sorted((data / "camera_boards/opencv_left").glob("*.jpg")), 532.5
    found["York Urban"] = sorted((data / "york_urban").glob("*.jpg"))[::3], 674.918
    return found


def magnified(image: ndarray, by: float) -> ndarray:
    """The middle of a picture, at its size."""
    height, width = image.shape[:2]
    box = (width / 2 * (1 - 1 / by), height / 2 * (1 - 1 / by), width / 2 * (1 + 1 / by), height / 2 * (1 + 1 / by))
    return np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.BICUBIC, box=box))


def main(begins: tuple[str, ...], groups: int, sizes: list[int], zoom: float) -> None:
    """Print a row for each set and number of photos."""
    torch.set_num_threads(1)
    print(describe_machine())
    heads = "set | photos | groups | answered | noticed | error %, without | with | 68 % half-width, without | with"
    heads += " | in 68 %, in 95 %, without | with | CPU s more"
    print(f"| {heads} |\n|{'---|' * (heads.count('|') + 1)}", flush=True)
    calibrator = PhotoCalibrator.load()
    for name, (files, focal) in lenses(Path(os.environ["SEXTANT_DATA"])).items():
        if not name.startswith(begins):
            continue
        seen = [read_photo(file).image for file in files]
        plain = described(calibrator, [(str(file), image) for file, image in zip(files, seen, strict=True)])
        changed = plain
        if zoom != 1:
            pictures = [(str(file), magnified(image, zoom)) for file, image in zip(files, seen, strict=True)]
            changed = described(calibrator, pictures)
        for size in sizes:
            if len(files) < size:
                continue
            starts = np.unique(np.linspace(0, len(files) - size, groups).round().astype(int)).tolist()
            rows = []
            for start in starts:
                half = start + (size + 1) // 2
                rows.append(measured([*plain[start:half], *changed[half : start + size]], focal, calibrator))
            print(f"| {name} | {size} | {cells(np.array(rows))} |", flush=True)


Described = tuple[Finding, LocalFeatures]


def described(calibrator: PhotoCalibrator, photos: list[tuple[str, ndarray]]) -> list[Described]:
    """The joint finding and the local features of each photo."""
    features, found = XFeatures(4096, 1024), []
    for finding, (_, image) in zip(find_cameras(calibrator.network, photos, look_at_lines=True), photos, strict=True):
        if not isinstance(finding, Finding):
            raise UserError(f"{finding.name}: {finding.error}")
        found.append((by_method(finding, "joint"), detected(features, image)))
    return found


def measured(photos: list[Described], focal: float, calibrator: PhotoCalibrator) -> tuple[float, ...]:
    """Whether matches answer, whether a zoom is noticed; without and with matches error, width, coverage, CPU s."""
    findings, row = [finding for finding, _ in photos], list[float]()
    noticed = answered = 0.0
    for use in (False, True):
        began = time.process_time()
        matches = None
        if use:
            matches = PhotoMatches(len(photos))
            matches.features = {finding.name: features for finding, features in photos}
        fused, _, doubts, told = fuse_as_one_camera(findings, None, matches)
        camera = photo_camera(fused[0], calibrator.network)
        near, wide = camera.interval_68.focal_px, camera.interval_95.focal_px
        row += [100 * (camera.focal_px / focal - 1), 50 * math.log(near[1] / near[0])]
        row += [float(ends[0] <= focal <= ends[1]) for ends in (near, wide)]
        row.append(time.process_time() - began)
        noticed = float(any("zoomed" in doubt or "disagree" in doubt for doubt in doubts))
        answered = float("photos match:" in told and not noticed)
    return answered, noticed, *row


def cells(rows: ndarray) -> str:
    """The rest of a row."""
    answered, noticed = int(rows[:, 0].sum()), int(rows[:, 1].sum())
    without, given = rows[:, 2:7], rows[:, 7:12]
    errors, widths, held = [], [], []
    for each in (without, given):
        a, b, c = np.quantile(np.abs(each[:, 0]), [0.25, 0.5, 0.75])
        errors.append(f"{b:.2f} [{a:.2f}, {c:.2f}]")
        widths.append(f"{np.median(each[:, 1]):.2f}")
        low, high = clopper(int(each[:, 3].sum()), len(each))
        held.append(f"{each[:, 2].sum():.0f}, {each[:, 3].sum():.0f} [{100 * low:.0f}, {100 * high:.0f}]")
    more = np.median(given[:, 4] - without[:, 4])
    return " | ".join([str(len(rows)), str(answered), str(noticed), *errors, *widths, *held, f"{more:.1f}"])


if __name__ == "__main__":
    given = parse_arguments(sys.argv[1:], KEYS, "python -m benchmarks.one_camera [sets=castle] [groups=4] [zoom=1.3]")
    main(
        tuple(given.get("sets", "").split(",")),
        int(given.get("groups", 4)),
        [int(size) for size in given.get("sizes", "6,10").split(",")],
        float(given.get("zoom", 1)),
    )
