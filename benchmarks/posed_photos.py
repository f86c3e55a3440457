"""Photos located in posed photos, and photos from elsewhere: ``python -m benchmarks.posed_photos``.

Three scenes of the EPFL multi-view benchmark (``strecha_posed``, laser-registered), each in three parts: every third
photo is located in the map of the others, with its camera known and unknown. Photos of York (``york_urban``) show
nothing of the maps. One thread; the descriptor alone is the pose of the most similar image.
"""

import csv
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from numpy import ndarray
from scipy.spatial.transform import Rotation

from benchmarks.machine import describe_machine
from sextant import PoseMap
from sextant.console.arguments import parse_arguments

PARTS, ELSEWHERE = 3, 34
#: the camera of York's photos: fx, fy, cx, cy
YORK = (675.0, 675.0, 319.5, 239.5)
KEYS = {"scene": "a part of a scene's name", "side": "longer side of the images in pixels (default: 1024)"}


def main(scene: str = "", side: int = 1024) -> None:
    """Print a row a scene and camera."""
    torch.set_num_threads(1)
    data = Path(os.environ["SEXTANT_DATA"])
    print(describe_machine())
    heads = ("scene", "camera", "photos", "error m", "error deg", "within 0.25 m, 2 deg", "located", "CPU s")
    heads += ("nearest image m", "largest log10 of false alarms")
    print(f"| {' | '.join(heads)} |")
    print(f"|{'---|' * len(heads)}")
    elsewhere = sorted((data / "york_urban").rglob("*.jpg"))[:: max(1, 102 // ELSEWHERE)]
    for name, (files, poses, camera) in scenes(data / "strecha_posed").items():
        if scene not in name:
            continue
        measured: dict[str, list[tuple[float, ...]]] = {"known": [], "unknown": []}
        nowhere: dict[str, list[tuple[float, bool]]] = {"known": [], "unknown": []}
        for part in range(PARTS):
            queries = np.arange(len(files)) % PARTS == part
            began = time.process_time()
            built = PoseMap.from_images(
                [files[k] for k in np.flatnonzero(~queries)], poses[~queries], camera, side=side
            )
            built_s, size = time.process_time() - began, len(built.names)
            for k in np.flatnonzero(queries).tolist():
                for kind, rows in measured.items():
                    rows.append(located(built, files[k], poses[k], camera if kind == "known" else None))
            for path in elsewhere[part::PARTS]:
                for kind, alarms in nowhere.items():
                    found = built.locate(path, YORK if kind == "known" else None)
                    alarms.append((found.log10_false_alarms, found.verdict == "located"))
        for kind, rows in measured.items():
            show(name, kind, np.array(rows))
            least, wrong = np.array(nowhere[kind]).T
            print(f"  York: {int(wrong.sum())} of {len(wrong)} located, least log10 of false alarms {least.min():.0f}")
        megabytes, each_s = built.posed.nbytes / size / 1e6, built_s / size
        print(
            f"  map: {size} images, {len(built.posed.points)} points; an image: {megabytes:.2f} MB, {each_s:.2f} CPU s"
        )


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


def located(built: PoseMap, path: Path, pose: ndarray, camera: object) -> tuple[float, ...]:
    """Errors in metres and degrees, seconds, whether it was located, and the error of the most similar image."""
    began = time.process_time()
    found = built.locate(path, camera)
    seconds = time.process_time() - began
    nearest = float(np.linalg.norm(built.posed.poses[:, :3, 3] - pose[:3, 3], axis=1).min())
    if found.world_from_camera is None:
        return np.inf, np.inf, seconds, 0.0, nearest, found.log10_false_alarms
    between = np.linalg.inv(pose) @ found.world_from_camera
    turn = float(np.rad2deg(Rotation.from_matrix(between[:3, :3]).magnitude()))
    return float(np.linalg.norm(between[:3, 3])), turn, seconds, 1.0, nearest, found.log10_false_alarms


def show(name: str, kind: str, rows: ndarray) -> None:
    """A row of the table: medians with the quartiles over photos."""
    metres, degrees, seconds, found, nearest, alarms = rows.T
    quartiles = [np.quantile(each, [0.25, 0.5, 0.75]) for each in (metres, degrees)]
    (a, m, b), (c, d, e) = (each.tolist() for each in quartiles)
    within = 100 * float(((metres < 0.25) & (degrees < 2)).mean())
    errors = f"{m:.3f} [{a:.3f}, {b:.3f}] | {d:.3f} [{c:.3f}, {e:.3f}] | {within:.0f} % | {100 * found.mean():.0f} %"
    rest = f"{np.median(seconds):.2f} | {np.median(nearest):.2f} | {alarms.max():.0f}"
    print(f"| {name} | {kind} | {len(rows)} | {errors} | {rest} |", flush=True)


if __name__ == "__main__":
    given = parse_arguments(sys.argv[1:], KEYS, "python -m benchmarks.posed_photos [scene=fountain] [side=1024]")
    main(given.get("scene", ""), int(given.get("side", 1024)))
