"""The resident memory of localization with a map in files that is larger than memory.

The map is built from a stream of images in one process, :class:`~sextant.localization.tiled_map.TiledMapBuilder`, and
used in another, so that their memory is measured separately. A filter with a concentrated belief reads only the tiles
with its particles' neighbourhoods. *Anonymous* memory cannot be reclaimed; *mapped* pages belong to the files, and the
system drops them when memory is short: while the map is built they are dropped whenever they exceed a budget, which
shows that this many suffice.
"""

import ctypes
import json
import mmap
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import torch
from rich.console import Console

from benchmarks.localization import DIMENSION, KERNEL, LIKELIHOOD, city_poses, smooth
from sextant.geometry.planar import se2_between
from sextant.localization.estimate import estimate
from sextant.localization.initialisation import UniformStart
from sextant.localization.map_prior import MapPrior
from sextant.localization.motion import ExponentialMotion
from sextant.localization.observation.cached_local_gp import CachedLocalGP
from sextant.localization.particle_filter import FilterState, ParticleFilter
from sextant.localization.recovery import NoRecovery
from sextant.localization.resampling import SystematicResampling
from sextant.localization.saved_map import load_map
from sextant.localization.tiled_map import TiledMapBuilder

IMAGES, NEIGHBOURS, BLOCK = 1_000_000, 8, 16_384
#: Mapped pages at most while the map is made, MB; particles and steps of the filter.
BUDGET_MB, PARTICLES, STEPS = 128, 1000, 100


def show_mapped(folder: Path, images: int, console: Console) -> None:
    """Build the map in one process, localize with it in another, and print the memory of both."""
    for stage in ("make", "localize"):
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.mapped_map", stage, str(folder), str(images)],
            check=True, capture_output=True, text=True,
        )  # fmt: skip
        console.print(f"{stage}: {done.stdout.strip()}", highlight=False)


# -- making it ---------------------------------------------------------------------------------------------------------


def make(folder: Path, images: int) -> dict[str, float]:
    """Add images in chunks of random order, and finish the map."""
    poses = city_poses(images)
    poses = poses[torch.randperm(len(poses), generator=torch.Generator().manual_seed(0))]
    began, before = time.perf_counter(), memory(folder)
    waves, peak = smooth(np.random.default_rng(0)), before
    builder = TiledMapBuilder(folder)
    for chunk in poses[builder.images :].split(BLOCK):
        builder.add(chunk, waves(chunk))
        peak = watched(peak, folder)
    added = time.perf_counter() - began

    def progress(done: int, of: int) -> None:
        nonlocal peak
        peak = watched(peak, folder)

    builder.finish(KERNEL, LIKELIHOOD, neighbours=NEIGHBOURS, progress=progress)
    files = sum(path.stat().st_size for path in folder.rglob("*.npy"))
    return {
        "files MB": files / 1e6,
        "anonymous MB, peak growth": peak["anonymous"] - before["anonymous"],
        "mapped MB, peak": peak["mapped"],
        "added s": added,
        "finished s": time.perf_counter() - began - added,
    }


# -- localizing in it --------------------------------------------------------------------------------------------------


def localize(folder: Path, images: int) -> dict[str, float]:
    """Follow a street from an approximate start."""
    before = memory(folder)
    model = load_map(folder, verify=False).model
    assert isinstance(model, CachedLocalGP)
    poses = model.map.poses
    opened = memory(folder)

    random, generator = np.random.default_rng(1), torch.Generator().manual_seed(0)
    truth = _street(poses)
    waves = smooth(np.random.default_rng(0))
    images_seen = waves(truth) + torch.from_numpy(random.normal(0, 0.02, (STEPS, DIMENSION)).astype(np.float32))
    motion = se2_between(truth[:-1], truth[1:])
    start = MapPrior(truth[:1], 5.0, 0.2)
    particle_filter = ParticleFilter(ExponentialMotion((0.2, 0.1, 0.02)), SystematicResampling(), NoRecovery(), start)
    state_now: FilterState = particle_filter.start(UniformStart(), 1, PARTICLES, generator)
    errors, seconds, tiles, peak = [], [], set[int](), opened
    for step in range(STEPS):
        began = time.perf_counter()
        evidence = model.observe(images_seen[step : step + 1], LIKELIHOOD)
        moved = motion[step - 1 : step] if step else None
        state_now, _ = particle_filter.step(state_now, moved, evidence, None, generator)
        found = estimate(state_now.belief, 5.0)
        seconds.append(time.perf_counter() - began)
        errors.append(float((found.pose[0, :2] - truth[step, :2]).norm()))
        tiles |= set(np.flatnonzero(~evidence.unread).tolist())
        peak = {name: max(peak[name], value) for name, value in memory(folder).items()}
    at_once = CachedLocalGP(NEIGHBOURS).load_state(model.map, KERNEL, model.state())
    whole = at_once.observe(images_seen[-1:], LIKELIHOOD).log_likelihood(state_now.belief.poses)
    apart = (whole - evidence.log_likelihood(state_now.belief.poses)).abs().max()
    return {
        "error m, median": float(np.median(errors)),
        "error m, greatest after 10 steps": float(np.max(errors[10:])),
        "ms per step, median": 1e3 * float(np.median(seconds)),
        "tiles read": float(len(tiles)),
        "of": float(len(evidence.unread)),
        "anonymous MB, opened": opened["anonymous"] - before["anonymous"],
        "anonymous MB, peak growth": peak["anonymous"] - before["anonymous"],
        "mapped MB, opened": opened["mapped"],
        "mapped MB, peak": peak["mapped"],
        "nats apart from the whole product": float(apart),
    }


def _street(poses: torch.Tensor) -> torch.Tensor:
    """Poses two metres apart eastwards along a street in the middle of the city."""
    middle = poses[:, :2].median(0).values
    start = torch.round(middle / 80.0) * 80.0
    along = 2.0 * torch.arange(STEPS, dtype=torch.float64)
    return torch.stack([start[0] + along, start[1].expand(STEPS), torch.zeros(STEPS, dtype=torch.float64)], dim=1)


# -- memory ------------------------------------------------------------------------------------------------------------


def memory(folder: Path) -> dict[str, float]:
    """Resident now, MB: anonymous memory, and pages of the folder's files."""
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    mapped, of_the_map = 0, False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        first = line.split(" ", 1)[0]
        if not first.endswith(":"):  # the head of a mapping
            of_the_map = line.endswith(".npy") and str(folder.resolve()) in line
        elif of_the_map and first == "Rss:":
            mapped += int(line.split()[1])
    return {"anonymous": int(status["RssAnon"].split()[0]) * 1024 / 1e6, "mapped": mapped * 1024 / 1e6}


def watched(peak: dict[str, float], folder: Path) -> dict[str, float]:
    """The peak so far; mapped pages of the folder's files are dropped if they are more than the budget."""
    now = memory(folder)
    if now["mapped"] > BUDGET_MB:
        drop_mapped(folder)
    return {name: max(peak[name], value) for name, value in now.items()}


def drop_mapped(folder: Path) -> None:
    """Drop the mapped pages of this process, as the system does when memory is short; the files keep them."""
    advise = ctypes.CDLL(None, use_errno=True).madvise
    advise.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
    for line in Path("/proc/self/maps").read_text().splitlines():
        if str(folder.resolve()) in line:
            first, last = (int(address, 16) for address in line.split()[0].split("-"))
            advise(first, last - first, mmap.MADV_DONTNEED)


if __name__ == "__main__":
    torch.set_num_threads(1)
    stage = {"make": make, "localize": localize}[sys.argv[1]]
    print(json.dumps({name: round(value, 3) for name, value in stage(Path(sys.argv[2]), int(sys.argv[3])).items()}))
