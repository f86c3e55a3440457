"""Photos located in rendered offices: ``python -m benchmarks.posed_office``.

Each office is mapped by one drive with known poses and camera, and frames of another drive along it are located by
day, by night, and in other light with furniture moved. Poses are exact, so that errors are those of correspondences.
Medians with 95 % intervals over offices (Student). Images are rendered once, to ``outputs/posed_office``.
"""

import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from numpy import ndarray
from scipy import stats
from scipy.spatial.transform import Rotation

from benchmarks.machine import describe_machine
from sextant import PoseMap
from sextant.console.arguments import parse_arguments
from sextant.correspondence import Pinhole
from sextant.data.rendered import open_store
from sextant.data.worlds import OfficeWalk
from sextant.data.worlds.shots import camera_poses

#: the conditions of the office dataset; the first is the map's
CONDITIONS = (
    *("summer_noon", "night_clear"),
    {
        "name": "moved",
        "condition": "spring_overcast",
        "cars_moved": 0.5,
        "facades_changed": 0.3,
        "change_seed": 1,
    },
)
NAMES = ("day", "night", "moved")
CACHE, FIRST_SEED, VFOV_DEG = Path("outputs/posed_office"), 501, 60.0
KEYS = {
    "offices": "number of offices (default: 3)",
    "size": "320x240 (default) or 96x64",
    "side": "longer side of the images for their features (default: 640)",
    "every": "use every n-th frame of the drive as a query (default: 8)",
    "map_every": "use every n-th frame of the map's drive (default: 3, about a metre)",
    "only": "render: render the images and stop",
}


def main(
    offices: int = 3, size: str = "320x240", side: int = 640, every: int = 8, map_every: int = 3, only: str = ""
) -> None:
    """Print a row a condition, over all offices."""
    torch.set_num_threads(1)
    width, height = (int(side) for side in size.split("x"))
    print(describe_machine())
    measured: dict[str, list[ndarray]] = {name: [] for name in NAMES}
    costs, map_sizes = [], []
    for seed in range(FIRST_SEED, FIRST_SEED + offices):
        began = time.process_time()
        images, poses, kind = office(seed, width, height)
        print(f"  office {seed}: {len(images)} images, {time.process_time() - began:.0f} CPU s", flush=True)
        if only == "render":
            continue
        lens = Pinhole.centred(width, height, height / 2 / np.tan(np.deg2rad(VFOV_DEG / 2)))
        began = time.process_time()
        mapped = np.flatnonzero(kind < 0)[::map_every]
        built = PoseMap.from_images(list(images[mapped]), poses[mapped], lens, side=side)
        map_sizes.append(len(mapped))
        costs.append((time.process_time() - began) / len(mapped))
        for number, name in enumerate(NAMES):
            rows = np.array(
                [located(built, images[k], poses[k], lens) for k in np.flatnonzero(kind == number)[::every]]
            )
            measured[name].append(rows)
            print(
                f"    {name}: median {np.median(rows[:, 0]):.3f} m, {100 * rows[:, 3].mean():.0f} % located", flush=True
            )
    if only != "render":
        show(measured, costs, map_sizes)


def office(seed: int, width: int, height: int, every: int = 8) -> tuple[ndarray, ndarray, ndarray]:
    """Images ``every`` 4 cm, ``world_from_camera``, and the condition of each query, -1 in the map."""
    laser = {"beams": 2, "field_of_view_rad": 3.0, "max_range_m": 15.0, "range_sigma_m": 0.02, "dropout": 0.0}
    dataset = OfficeWalk(
        roots=[CACHE], size_m=[46.0, 16.0], metres=[80.0, 12.0], trajectories=[], every=every, width=width,
        height=height, vfov_deg=VFOV_DEG, samples=4, conditions=list(CONDITIONS), laser=laser, seed=seed,
    )  # fmt: skip
    store = open_store(dataset.plan(), CACHE)
    if not store.complete:
        store.fill(lambda done, total: None, 1)
    columns = store.columns
    images = np.asarray(store.mapped("images", np.arange(len(store)), 1)[:])
    return images, camera_poses(columns["pose"]), np.where(columns["split"] == 0, -1, columns["condition"])


def located(built: PoseMap, image: ndarray, pose: ndarray, camera: object) -> tuple[float, ...]:
    """Errors in metres and degrees, CPU seconds, whether it was located, and the squared error by its covariance."""
    began = time.process_time()
    found = built.locate(image, camera)
    seconds = time.process_time() - began
    if found.world_from_camera is None or found.covariance is None:
        return np.inf, np.inf, seconds, 0.0, np.nan
    between = np.linalg.inv(pose) @ found.world_from_camera
    error = np.concatenate([between[:3, 3], Rotation.from_matrix(between[:3, :3]).as_rotvec()])
    squared = float(error @ np.linalg.solve(found.covariance, error))
    return float(np.linalg.norm(error[:3])), float(np.rad2deg(np.linalg.norm(error[3:]))), seconds, 1.0, squared


def show(measured: dict[str, list[ndarray]], costs: list[float], map_sizes: list[int]) -> None:
    """A row of the table a condition: the mean over offices of each office's value, with its interval."""
    heads = ("queries", "median error m", "median error deg", "within 0.25 m, 2 deg", "located", "in 95 % regions")
    print(f"| {' | '.join((*heads, 'CPU s'))} |\n|{'---|' * (len(heads) + 1)}")
    for name, worlds in measured.items():
        cells = [
            interval([np.median(rows[:, 0]) for rows in worlds], 3),
            interval([np.median(rows[:, 1]) for rows in worlds], 2),
            interval([100 * ((rows[:, 0] < 0.25) & (rows[:, 1] < 2)).mean() for rows in worlds], 0) + " %",
            interval([100 * rows[:, 3].mean() for rows in worlds], 0) + " %",
            interval([_held(rows) for rows in worlds], 0) + " %",
            f"{np.median(np.concatenate(worlds)[:, 2]):.2f}",
        ]
        print(f"| {name} | {' | '.join(cells)} |")
    print(f"maps of {min(map_sizes)} to {max(map_sizes)} images, {np.mean(costs):.2f} CPU s an image")


def _held(rows: ndarray) -> float:
    """Percent of located queries in their 95 % region."""
    found = rows[rows[:, 3] > 0, 4]
    return 100 * float((found < stats.chi2.ppf(0.95, 6)).mean()) if len(found) else np.nan


def interval(values: list[float], digits: int) -> str:
    """Mean and 95 % interval over offices; the median where a value is infinite."""
    array = np.array(values, float)
    array = array[~np.isnan(array)]
    if not np.isfinite(array).all() or len(array) < 2:
        return f"{np.median(array):.{digits}f}" if len(array) else "-"
    half = stats.t.ppf(0.975, len(array) - 1) * array.std(ddof=1) / np.sqrt(len(array))
    return f"{array.mean():.{digits}f} ± {half:.{digits}f}"


if __name__ == "__main__":
    given = parse_arguments(sys.argv[1:], KEYS, "python -m benchmarks.posed_office [offices=3] [size=320x240]")
    numbers = {key: int(given[key]) for key in ("offices", "side", "every", "map_every") if key in given}
    main(size=given.get("size", "320x240"), only=given.get("only", ""), **numbers)
