"""Peers of the particle filter on the same walks: ``python -m benchmarks.localization_peers seeds=8 csv=walks.csv``.

All use the default descriptors of ``Localizer.from_images`` and the same odometry. Peers without our filter get
descriptors less the running mean of the walk (our filter subtracts its own). A real walk is a hundred steps from a
place chosen by the seed, with an odometry error of a tenth; *uneven*: for ten steps at a time the camera stands still,
moves at the map's pace, or at twice that. Each seed has another office. Evaluated from the twentieth frame on.
Shares have Korn and Graubard's 95 % intervals over seeds; differences from our filter are paired, with t intervals, and
so are the ratios of median errors, in logarithms. Parameters of peers are those of their authors, or the map's spacing;
none was fitted to a walk. The laser has AMCL's likelihood field; it starts about the poses of the map,
and its augmented injection averages likelihoods geometrically, which is better here than AMCL's arithmetic mean.
"""

import csv
import os
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy import ndarray
from rich.console import Console
from rich.table import Table

from benchmarks.changed_walks import WALKS, photos
from benchmarks.landmarks import office
from benchmarks.machine import describe_machine
from benchmarks.topological_filter import TopologicalFilter, likelihood_rate
from sextant import Localizer
from sextant.baselines.place_descriptors import unit_norm
from sextant.chapters.localization.data.drive import Drive
from sextant.console.arguments import parse_arguments
from sextant.evaluation import mean_interval, share_interval
from sextant.localization.initialisation import UniformStart
from sextant.localization.laser import LikelihoodField
from sextant.localization.localize import localize
from sextant.localization.observers import Laser
from sextant.localization.recovery import AugmentedMCL
from sextant.retrieval.sequence_matching import CONTRAST_WINDOW, match_sequences
from sextant.retrieval.without_mean import centred
from sextant.worlds.occupancy import occupancy_from_scans

KEYS = {
    "seeds": "their number; 8 by default",
    "walks": "those whose names begin with this; all by default",
    "csv": "a file for the result of each seed",
}
USAGE = "python -m benchmarks.localization_peers seeds=8 csv=walks.csv"
FRAMES, JUDGED_FROM, PACE_KEPT, BEAMS = 100, 20, 10, 60
#: metres: two images of the real walks, which have one per metre, and the limit for a corridor
LIMITS = {"line": 2.0, "office": 0.9}
LINES = ("Gardens Point, day", "Gardens Point, night", "Nordland, winter, 0 to 299",
         "Nordland, winter, 300 to 599", "Nordland, winter, 600 to 899")  # fmt: skip
OURS, PARTICLES = "particles, 2,000", (500, 2000)
MEASURES = ("within", "median_error", "cpu_us_a_frame")


@dataclass(frozen=True)
class Walk:
    """The input of all methods: the map, and for each frame the descriptor, odometry and truth."""

    poses: ndarray
    known: ndarray
    seen: ndarray
    motion: ndarray
    truth: ndarray

    def similarities(self) -> ndarray:
        """Cosines less running means, query by map."""
        reference, query = centred(unit_norm(self.known), unit_norm(self.seen), "running")
        return np.asarray(query @ reference.T)


#: poses of all frames
Method = Callable[[Walk, int], ndarray]


def nearest(walk: Walk, seed: int) -> ndarray:
    """The poses of the most similar images."""
    return walk.poses[walk.similarities().argmax(axis=1)]


def sequences(walk: Walk, seed: int, contrast: int | None) -> ndarray:
    """The poses of the images at the ends of the best lines through the last ten frames."""
    return walk.poses[match_sequences(walk.similarities(), contrast_window=contrast).indices[:, 0]]


def topological(walk: Walk, seed: int) -> ndarray:
    """The poses of the likeliest images by a Bayes filter over images."""
    filter = TopologicalFilter.of(torch.from_numpy(walk.poses))
    distances = torch.from_numpy(np.sqrt(np.clip(2 - 2 * walk.similarities().astype(np.float64), 0, None)))
    rate, belief, best = likelihood_rate(distances[0]), filter.uniform(), []
    for row, motion in zip(distances, walk.motion, strict=True):
        belief = filter.step(belief, motion, row, rate)
        best.append(int(belief.argmax()))
    return walk.poses[best]


def ours(walk: Walk, seed: int, localizer: Localizer, particles: int) -> ndarray:
    """The default particle filter of images."""
    localizer.particles = particles
    localizer.reset(seed)
    steps = zip(walk.motion, walk.seen, strict=True)
    return np.stack([localizer.step(motion, descriptor=row).pose for motion, row in steps])


def amcl(walk: Walk, seed: int, localizer: Localizer, laser: Laser) -> ndarray:
    """The same filter with a laser: uniform start, augmented injection, likelihood field."""
    frames = np.arange(len(walk.seen))[:, None]
    filter = replace(localizer.filter, recovery=AugmentedMCL(), support=None)
    track = localize(
        filter, UniformStart(), laser, frames, walk.motion[:, None], np.ones(frames.shape, bool),
        torch.Generator().manual_seed(seed), particles=PARTICLES[-1], radius=localizer.radius,
    )  # fmt: skip
    return track.pose[:, 0]


def methods(localizer: Localizer) -> dict[str, Method]:
    """All methods that use images."""
    return {
        "nearest image": nearest,
        "sequences": partial(sequences, contrast=None),
        "sequences, local contrast": partial(sequences, contrast=CONTRAST_WINDOW),
        "topological": topological,
        **{f"particles, {count:,}": partial(ours, localizer=localizer, particles=count) for count in PARTICLES},
    }


def measured(walk: Walk, compared: dict[str, Method], seed: int, limit: float) -> Iterator[dict]:
    """Each method on one walk."""
    for name, method in compared.items():
        began = time.process_time()
        found = method(walk, seed)
        spent = (time.process_time() - began) / len(walk.seen)
        errors = np.hypot(*(found - walk.truth)[JUDGED_FROM:, :2].T)
        values = (float(np.mean(errors <= limit)), float(np.median(errors)), 1e6 * spent)
        yield {"method": name, **dict(zip(MEASURES, values, strict=True))}


def along(known: ndarray, seen: ndarray, seed: int, *, uneven: bool) -> Walk:
    """A walk along a line of one image a metre, with odometry."""
    rng = np.random.default_rng(seed)
    count = min(FRAMES, len(seen))
    paces = np.repeat(rng.integers(0, 3, count // PACE_KEPT + 1), PACE_KEPT)[:count] if uneven else np.ones(count, int)
    way = np.cumsum(paces) - paces[0]
    way = way[way < len(seen)]
    at = rng.integers(len(seen) - way[-1]) + way
    paces = paces[: len(at), None]
    noise = rng.standard_normal((len(at), 3))
    motion = paces * (np.array([1.0, 0.0, 0.0]) + np.array([0.1, 0.02, 0.005]) * noise)
    poses, truth = np.zeros((len(known), 3)), np.zeros((len(at), 3))
    poses[:, 0], truth[:, 0] = np.arange(len(known)), at
    return Walk(poses, known, seen[at], motion, truth)


def on_line(images: ndarray, seen: ndarray, seeds: range) -> Iterator[dict]:
    """A real walk at both paces."""
    poses = np.zeros((len(images), 3))
    poses[:, 0] = np.arange(len(images))
    localizer = Localizer.from_images(images, poses)
    known = localizer.model.map.descriptors.numpy()
    described = np.stack([localizer.describe(image) for image in seen])
    for seed in seeds:
        for pace in ("even", "uneven"):
            walk = along(known, described, seed, uneven=pace == "uneven")
            for row in measured(walk, methods(localizer), seed, LIMITS["line"]):
                yield {"descriptor": described_by(localizer), "pace": pace, "seed": seed, **row}


def in_office(seed: int, folder: Path) -> Iterator[dict]:
    """The drives of one office, and a laser beside the camera."""
    data = office(seed, folder, BEAMS)
    images = np.asarray(data.map.images[np.arange(len(data.map))])
    localizer = Localizer.from_images(images, data.map.poses)
    grid = occupancy_from_scans(data.scanner, data.map.poses, np.asarray(data.map.laser, np.float64), 0.05)
    field = LikelihoodField(grid, data.scanner)  # AMCL's parameters
    for drive in data.test:
        walk = office_walk(localizer, drive)
        laser = Laser(field, drive.laser, torch.from_numpy(data.map.poses))
        compared = {
            **methods(localizer),
            f"laser, {PARTICLES[-1]:,}": partial(amcl, localizer=localizer, laser=laser),
        }
        for row in measured(walk, compared, seed, LIMITS["office"]):
            walked = f"office, {drive.condition.replace('_', ' ')}"
            yield {"walk": walked, "descriptor": described_by(localizer), "pace": "even", "seed": seed, **row}


def described_by(localizer: Localizer) -> str:
    """The descriptor that was used."""
    facts = localizer.descriptor.facts
    return str(facts.get("class", facts["kind"]))


def office_walk(localizer: Localizer, drive: Drive) -> Walk:
    """A drive, described."""
    seen = np.stack([localizer.describe(drive.images[k]) for k in range(len(drive))])
    mapped = localizer.model.map
    return Walk(mapped.poses.numpy(), mapped.descriptors.numpy(), seen, drive.motion, drive.poses)


def summary(rows: list[dict]) -> list[list[str]]:
    """By walk and method: share with its interval, less ours, median error; error and time as ratios to ours."""
    by: dict[tuple[str, str, str], dict[int, list[float]]] = defaultdict(dict)
    for row in rows:
        by[row["walk"], row["pace"], row["method"]][row["seed"]] = [row[name] for name in MEASURES]
    lines = []
    for (walk, pace, method), seeds in by.items():
        values, own = (np.array([found[seed] for seed in sorted(seeds)]) for found in (seeds, by[walk, pace, OURS]))
        low, high = share_interval(values[:, 0], len(values))
        cells = [walk, pace, method, f"{100 * values[:, 0].mean():.0f} [{100 * low:.0f}, {100 * high:.0f}]"]
        less = values[:, 0] - own[:, 0]
        low, high = mean_interval(less)
        same = method == OURS
        cells.append("" if same else f"{100 * less.mean():+.0f} [{100 * low:+.0f}, {100 * high:+.0f}]")
        error = "" if same else "–"  # an image of the map may have no error at all
        if not same and min(values[:, 1].min(), own[:, 1].min()) > 0:
            times = np.log(values[:, 1] / own[:, 1])
            middle, low, high = np.exp([times.mean(), *mean_interval(times)])
            error = f"{middle:.2f} [{low:.2f}, {high:.2f}]"
        ratio = np.median(values[:, 2]) / np.median(own[:, 2])
        lines.append([*cells, f"{np.median(values[:, 1]):.2f}", error, f"{ratio:.3f}"])
    return lines


def all_walks(begins: str, seeds: range) -> Iterator[dict]:
    """The rows of walks whose names begin with ``begins``."""
    if begins.startswith("office") or not begins:
        with tempfile.TemporaryDirectory() as folder:
            for seed in seeds:
                yield from in_office(seed, Path(folder))
    for name in (name for name in LINES if name.startswith(begins)):
        data = Path(os.environ["SEXTANT_DATA"])
        map_folder, query_folder, first, last = WALKS[name]
        images, _ = photos(data / map_folder, "gallery", first, last, None)
        seen, _ = photos(data / query_folder, "query", first, last, None)
        yield from ({"walk": name, **row} for row in on_line(images, seen, seeds))


def main() -> None:
    """Measure all walks."""
    given, rows = parse_arguments(sys.argv[1:], KEYS, USAGE), list[dict]()
    begins = given.get("walks", "")
    known = [name for name in ("office", *LINES) if name.startswith(begins) or begins.startswith(name)]
    if not known:
        raise SystemExit(f"walks={begins}: no walk begins with this; choose among office, {', '.join(LINES)}")
    if set(known) & set(LINES) and "SEXTANT_DATA" not in os.environ:
        raise SystemExit(f"SEXTANT_DATA is not set, and {known[-1]} is read from there; walks=office needs none")
    with ExitStack() as stack:
        file = stack.enter_context(Path(given["csv"]).open("w", newline="")) if "csv" in given else None
        for row in all_walks(begins, range(int(given.get("seeds", 8)))):
            if file is not None:  # at once, so that nothing is lost
                csv.DictWriter(file, list(row)).writerows(
                    [dict(zip(row, row, strict=True)), row] if not rows else [row]
                )
                file.flush()
            rows.append(row)
            print(*row.values(), flush=True)
    table = Table("walk", "pace", "method", "within, %", "less ours", "median error, m", "error / ours", "time / ours")
    for line in summary(rows):
        table.add_row(*line)
    console = Console(width=150)
    console.print(describe_machine())
    console.print(table)


if __name__ == "__main__":
    main()
