"""Photos located in posed photos, and photos from elsewhere: ``python -m benchmarks.posed_photos``.

Three scenes of the EPFL multi-view benchmark (``strecha_posed``, laser-registered), each in three parts: every third
photo is located in the map of the others, with its camera known and unknown. The scenes lie in one courtyard, so that
photos of other sets, not of other scenes, show nothing of the maps. Features are detected once. One thread.
"""

import csv
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from numpy import ndarray
from scipy.stats import chi2

from benchmarks.machine import describe_machine
from sextant.chapters.localization.pose_map import CANDIDATES, DESCRIPTOR, LOG10_FALSE_ALARMS, _features_of
from sextant.chapters.places.saved_descriptor import kept_network
from sextant.console.arguments import parse_arguments
from sextant.correspondence import LocalFeatures, Pinhole, PosedMap, PoseErrors, XFeatures, build_map, calibrated
from sextant.correspondence.left_out import displacement, squared_error
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.resolve import resolve_run

PARTS = 3
#: photos of other places, and which of each set are tried
ELSEWHERE = (
    *(("york_urban/*.jpg", 4), ("photos/lund/*.jpg", 2), ("exif_focal/*.jpg", 3), ("gardens_point/day_left/*", 40)),
    *(("gardens_point/night_right/*", 40), ("corridor_twice/query/*", 4)),
)
KEYS = {"scene": "a part of a scene's name", "side": "longer side of the images in pixels (default: 1024)"}
Described = tuple[list[LocalFeatures], ndarray]


def main(scene: str = "", side: int = 1024) -> None:
    """Print a row a scene and camera, and one a set from elsewhere."""
    torch.set_num_threads(1)
    data = Path(os.environ["SEXTANT_DATA"])
    print(describe_machine())
    heads = ("scene", "camera", "photos", "error m", "error deg", "within 0.25 m, 2 deg", "median chi2, as it was")
    heads += ("in 95 % regions, as it was", "CPU s without features", "largest log10 of false alarms")
    print(f"| {' | '.join(heads)} |")
    print(f"|{'---|' * len(heads)}")
    lowest: dict[str, list[float]] = {}
    others = {
        name: described([path for path in sorted(data.glob(name)) if path.is_file()][::step], side)[1]
        for name, step in ELSEWHERE
    }
    for name, (files, poses, given) in scenes(data / "strecha_posed").items():
        if scene not in name:
            continue
        detecting, (features, vectors) = described(files, side)
        camera = Pinhole(features[0].width, features[0].height, *given)
        measured: dict[str, list[tuple[float, ...]]] = {"known": [], "unknown": []}
        factors = []
        for part in range(PARTS):
            queries = np.arange(len(files)) % PARTS == part
            rest = np.flatnonzero(~queries)
            began = time.process_time()
            posed = build_map([features[k] for k in rest], poses[rest], [camera] * len(rest))
            building, began = time.process_time() - began, time.process_time()
            posed = calibrated(posed)
            calibrating = time.process_time() - began
            factors.append(posed.errors)
            for k in np.flatnonzero(queries).tolist():
                for kind, rows in measured.items():
                    sigma = 0.0 if kind == "known" else None
                    rows.append(located(posed, vectors[rest], features[k], vectors[k], camera, sigma, poses[k]))
            if part:
                continue
            for other, (theirs, rows) in others.items():
                for each, row in zip(theirs, rows, strict=True):
                    order = np.argsort(-(vectors[rest] @ row), kind="stable")[:CANDIDATES].tolist()
                    lens = Pinhole.centred(each.width, each.height, float(max(each.width, each.height)))
                    found = [posed.locate(each, order, lens, sigma).log10_false_alarms for sigma in (0.0, None)]
                    lowest.setdefault(other, []).append(min(found))
        for kind, rows in measured.items():
            show(name, kind, np.array(rows))
        size = len(rest)
        print(
            f"  maps: {', '.join(f'{e.scale:.1f} S + {e.displacement:.3f} m, {e.rotation:.5f} rad' for e in factors)}; "
            f"an image: {posed.nbytes / size / 1e6:.2f} MB; CPU s: features {detecting / len(files):.2f}, "
            f"map {building / size:.2f}, calibration {calibrating / size:.2f}",
            flush=True,
        )
    show_elsewhere(lowest)


def described(files: list[Path], side: int) -> tuple[float, Described]:
    """CPU seconds, local features and global descriptors."""
    network = kept_network(resolve_run(DESCRIPTOR, default_outputs()).checkpoint)
    began = time.process_time()
    found = _features_of(files, XFeatures(4096, side), network, lambda done, total: None)
    return time.process_time() - began, found


def show_elsewhere(lowest: dict[str, list[float]]) -> None:
    """The lowest logarithm of false alarms of each set, beside that of the other sets."""
    print("| photos from elsewhere | tried | lowest log10 of false alarms | of the other sets | located |")
    print("|---|---|---|---|---|")
    for name, values in lowest.items():
        rest = min(min(each) for other, each in lowest.items() if other != name)
        wrong = sum(value <= LOG10_FALSE_ALARMS for value in values)
        print(f"| {name} | {len(values)} | {min(values):.0f} | {rest:.0f} | {wrong} |")


def scenes(folder: Path) -> dict[str, tuple[list[Path], ndarray, tuple[float, ...]]]:
    """Files, poses and camera of each scene."""
    with (folder / "poses.csv").open() as file:
        rows = list(csv.DictReader(file))
    found = {}
    for name in dict.fromkeys(row["scene"] for row in rows):
        own = [row for row in rows if row["scene"] == name]
        poses = np.tile(np.eye(4), (len(own), 1, 1))
        for pose, row in zip(poses, own, strict=True):
            pose[:3, :3] = [[float(row[f"r{i}{j}"]) for j in range(3)] for i in range(3)]
            pose[:3, 3] = [float(row[key]) for key in ("cx_m", "cy_m", "cz_m")]
        camera = tuple(float(own[0][key]) for key in ("fx", "fy", "ppx", "ppy"))
        found[name] = ([folder / row["file"] for row in own], poses, camera)
    return found


def located(
    posed: PosedMap,
    vectors: ndarray,
    query: LocalFeatures,
    vector: ndarray,
    camera: Pinhole,
    sigma: float | None,
    pose: ndarray,
) -> tuple[float, ...]:
    """Errors in metres and degrees, seconds, squared errors by the covariance, without the map's too, false alarms."""
    began = time.process_time()
    order = np.argsort(-(vectors @ vector), kind="stable")[:CANDIDATES].tolist()
    found = posed.locate(query, order, camera, sigma)
    seconds = time.process_time() - began
    if found.pose is None or found.log10_false_alarms > LOG10_FALSE_ALARMS:
        return np.inf, np.inf, seconds, np.inf, np.inf, found.log10_false_alarms
    error = displacement(found.pose.world_from_camera, pose)
    metres, degrees = float(np.linalg.norm(error[:3])), float(np.rad2deg(np.linalg.norm(error[3:])))
    plain = replace(posed, errors=PoseErrors()).locate(query, order, camera, sigma).pose
    squared = [squared_error(each, pose) for each in (found.pose, plain) if each is not None]
    return metres, degrees, seconds, *squared, found.log10_false_alarms


def show(name: str, kind: str, rows: ndarray) -> None:
    """A row of the table: medians with the quartiles over photos."""
    metres, degrees, seconds, squared, plain, alarms = rows.T
    quartiles = [np.quantile(each, [0.25, 0.5, 0.75]) for each in (metres, degrees)]
    (a, m, b), (c, d, e) = (each.tolist() for each in quartiles)
    within = 100 * float(((metres < 0.25) & (degrees < 2)).mean())
    errors = f"{m:.3f} [{a:.3f}, {b:.3f}] | {d:.3f} [{c:.3f}, {e:.3f}] | {within:.0f} %"
    limit = chi2.ppf(0.95, 6)
    held = f"{np.sum(squared < limit)} of {len(rows)}, {np.sum(plain < limit)}"
    spread = f"{np.median(squared):.1f}, {np.median(plain):.1f}"
    print(
        f"| {name} | {kind} | {len(rows)} | {errors} | {spread} | {held} | "
        f"{np.median(seconds):.2f} | {alarms.max():.0f} |",
        flush=True,
    )


if __name__ == "__main__":
    given = parse_arguments(sys.argv[1:], KEYS, "python -m benchmarks.posed_photos [scene=fountain] [side=1024]")
    main(given.get("scene", ""), int(given.get("side", 1024)))
