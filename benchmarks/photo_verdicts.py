"""How far the verdicts on real photos can be trusted: ``python -m benchmarks.photo_verdicts run=<run>``.

Each source is a folder of ``SEXTANT_DATA`` with a table of its own name: ``file`` and the true focal length ``f_px``.
"""

import csv
import os
import sys
from pathlib import Path

from sextant import PhotoCalibrator
from sextant.applications import PhotoCamera
from sextant.cli.arguments import parse_arguments

KEYS = {"run": "of calibration: its directory or checkpoint"}
SOURCES = ("york_urban", "phone_gravity", "exif_focal")
WRONG = 0.2  # relative error of the focal length
DOUBTS_OF_RANGE = ("at the end of what", "the 95 % interval reaches", "it does not look like")


def row(source: str, data: Path, calibrator: PhotoCalibrator) -> dict[str, object]:
    """Counts of one source."""
    with open(data / source / f"{source}.csv", newline="") as table:
        truth = {data / source / entry["file"]: float(entry["f_px"]) for entry in csv.DictReader(table)}
    found = dict(zip(truth, calibrator.calibrate_many(truth, errors="return"), strict=True))
    cameras = {path: camera for path, camera in found.items() if isinstance(camera, PhotoCamera)}
    wrong = {path for path, camera in cameras.items() if abs(camera.focal_px / truth[path] - 1) > WRONG}
    good = {path for path, camera in cameras.items() if camera.verdict == "good"}
    plain = {path for path, c in cameras.items() if all(reason.startswith(DOUBTS_OF_RANGE) for reason in c.reasons)}
    inside = [c.interval_95.focal_px[0] <= truth[p] <= c.interval_95.focal_px[1] for p, c in cameras.items()]
    return {
        "source": source,
        "photos": len(cameras),
        "off by over 20 %": len(wrong),
        "good": len(good),
        "good, off": len(good & wrong),
        "good but for range and looks": len(plain),
        "of these off": len(plain & wrong),
        "truth in the 95 % interval": sum(inside),
    }


def main() -> None:
    given = parse_arguments(sys.argv[1:], KEYS, "python -m benchmarks.photo_verdicts run=<run>")
    calibrator = PhotoCalibrator.load(given["run"])
    rows = [row(source, Path(os.environ["SEXTANT_DATA"]), calibrator) for source in SOURCES]
    print("| " + " | ".join(rows[0]) + " |\n|" + "---|" * len(rows[0]))
    for each in rows:
        print("| " + " | ".join(map(str, each.values())) + " |")


if __name__ == "__main__":
    main()
