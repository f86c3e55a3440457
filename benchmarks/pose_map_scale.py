"""Time and memory of maps of posed photos by their size: ``python -m benchmarks.pose_map_scale``.

A map of 29 of the 30 photos of castle (``strecha_posed``) is built; larger maps are copies of it, a kilometre apart,
whose global descriptors are turned at random, so that copies are as unlike as places of one city. The photo left out
is located in each saved and opened map. Building grows with the pairs of neighbours, which is shown with the 128
strongest keypoints.
"""

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from numpy import ndarray

from benchmarks.machine import describe_machine
from benchmarks.posed_photos import scenes
from sextant import PoseMap
from sextant.console.arguments import parse_arguments
from sextant.correspondence import PosedMap, build_map

SIZES, STRONGEST, REPEATS, LEFT_OUT = (29, 1015, 10005), 128, 5, 7
KEYS = {"largest": "images of the largest map (default: 10005)"}


def main(largest: int = 10005) -> None:
    """Print both tables."""
    torch.set_num_threads(1)
    print(describe_machine())
    files, poses, camera = scenes(Path(os.environ["SEXTANT_DATA"]) / "strecha_posed")["castle-P30"]
    photo, truth = files.pop(LEFT_OUT), poses[LEFT_OUT, :3, 3]
    poses = np.delete(poses, LEFT_OUT, axis=0)
    seconds, built = timed(lambda: PoseMap.from_images(files, poses, camera))
    images = len(files)
    print(
        f"built of {images} photos: {seconds / images:.2f} CPU s an image, {built.posed.nbytes / images / 1e6:.2f} MB"
    )
    print("| images | open CPU s | memory MB more | locate CPU s | m from the truth | build CPU s, 128 keypoints |")
    print("|---|---|---|---|---|---|")
    for size in (size for size in SIZES if size <= largest):
        few = [each.strongest(STRONGEST) for each in built.posed.features]
        copies = copied(built.posed, size // images)
        growth, _ = timed(lambda c=copies, f=few: build_map(f * (len(c.poses) // len(f)), c.poses, c.cameras))
        folder = Path(tempfile.mkdtemp(dir="outputs"))
        try:
            saved = PoseMap(copies, built.names * (size // images), turned(built, size), *kept(built))
            saved.save(folder)
            words = [sys.executable, "-m", "benchmarks.pose_map_scale", f"opened={folder}", f"photo={photo}"]
            told = subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()
            opened, memory, locating, *position = (float(word) for word in told)
        finally:
            shutil.rmtree(folder)
        apart = np.linalg.norm(np.array(position) - truth)
        print(f"| {size:,} | {opened:.1f} | {memory:.0f} | {locating:.2f} | {apart:.3f} | {growth:.1f} |", flush=True)


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """CPU seconds, and the result."""
    began = time.process_time()
    result = work()
    return time.process_time() - began, result


def kept(built: PoseMap) -> tuple[Any, Any, Any]:
    """What describes images."""
    return built._described_by, built._features, built._local


def turned(built: PoseMap, size: int) -> ndarray:
    """Global descriptors of the copies, of the first as they are."""
    rows, rng = built._descriptors, np.random.default_rng(0)
    parts = [rows]
    while sum(map(len, parts)) < size:
        parts.append(rows[:, rng.permutation(rows.shape[1])] * rng.choice([-1, 1], rows.shape[1]))
    return np.concatenate(parts).astype(np.float32)


def copied(posed: PosedMap, copies: int) -> PosedMap:
    """The map side by side with copies of itself."""
    shifts = np.zeros((copies, 3))
    shifts[:, 0], shifts[:, 1] = 1000.0 * (np.arange(copies) % 20), 1000.0 * (np.arange(copies) // 20)
    poses = np.concatenate([posed.poses] * copies)
    poses[:, :3, 3] += np.repeat(shifts, len(posed.poses), axis=0)
    points = np.concatenate([posed.points + shift for shift in shifts])
    numbers = [
        np.where(each >= 0, each + k * len(posed.points), -1).astype(np.int32)
        for k in range(copies)
        for each in posed.point_of
    ]
    return replace(
        posed, features=list(posed.features) * copies, poses=poses, cameras=list(posed.cameras) * copies,
        points=points, covariances=np.tile(posed.covariances, (copies, 1, 1)), point_of=numbers,
    )  # fmt: skip


def opened_map(folder: Path, photo: Path) -> None:
    """Print the CPU seconds of opening, the memory that it takes, and the seconds and position of a photo."""
    torch.set_num_threads(1)
    before = resident()
    opening, poses = timed(lambda: PoseMap.open(folder))
    memory = resident() - before
    camera = poses.posed.cameras[0]
    poses.locate(photo, camera)
    located = [timed(lambda: poses.locate(photo, camera)) for _ in range(REPEATS)]
    found = located[0][1].world_from_camera
    print(opening, memory, np.median([seconds for seconds, _ in located]), *found[:3, 3])


def resident() -> float:
    """Private memory of this process, MB: files that are mapped count only what was changed."""
    pages = Path("/proc/self/statm").read_text().split()
    return (int(pages[1]) - int(pages[2])) * resource.getpagesize() / 1e6


if __name__ == "__main__":
    keys = KEYS | {"opened": "a saved map", "photo": "a photo"}
    given = parse_arguments(sys.argv[1:], keys, "python -m benchmarks.pose_map_scale [largest=1015]")
    if "opened" in given:
        opened_map(Path(given["opened"]), Path(given["photo"]))
    else:
        main(int(given.get("largest", 10005)))
