"""A default localizer on real walks in a changed world: ``python -m benchmarks.changed_walks seeds=8``.

Maps have one image per metre along a line; odometry has an error of a tenth. Evaluated from the sixtieth step on,
once per seed. ``odometry=none`` tests the default without odometry, and the nearest image of the map. ``odometry=true``
tests the default with a constant bias of odometry, without odometry, standing still for the last forty steps, with
broken odometry, and on a drive through another world, where every frame that is not *lost* counts as *sure and wrong*.
IE Tower's walks lead through clips of its floors, one after the other; every fifth frame is not in the map. ESSEX3IN1
is not a walk but pairs of photos of places, treated here as a sequence.
"""

import csv
import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy import ndarray
from PIL import Image
from rich.console import Console
from rich.table import Table

from sextant import Localizer
from sextant.baselines import WhitenedPCA
from sextant.chapters.localization.saved_filter import fitted_kernel
from sextant.chapters.places.saved_descriptor import SavedDescriptor
from sextant.console.arguments import parse_arguments
from sextant.evaluation import share_interval
from sextant.localization.observation.cached_local_gp import CachedLocalGP
from sextant.localization.recovery import BayesRestart
from sextant.retrieval.flat_index import FlatIndex

KEYS = {
    "seeds": "their number; 8 by default",
    "walks": "those whose names begin with this; all by default",
    "rows": "shrink all images to this many rows, and compare descriptors alone",
    "odometry": "true: the default alone, with odometry worse than specified; none: without odometry",
}
CHI2_95 = 5.991  # in two dimensions
JUDGED_FROM = 60
#: map, query and their stretch of images
WALKS = {
    "Gardens Point, day": ("gardens_point/day_left", "gardens_point/day_right", 0, 200),
    "Gardens Point, night": ("gardens_point/day_left", "gardens_point/night_right", 0, 200),
    "Nordland, winter, 0 to 299": ("nordland/summer", "nordland/winter", 0, 300),
    "Nordland, winter, 300 to 599": ("nordland/summer", "nordland/winter", 300, 600),
    "Nordland, winter, 600 to 899": ("nordland/summer", "nordland/winter", 600, 900),
    "Nordland, winter, 1500 to 1799": ("nordland/summer", "nordland/winter", 1500, 1800),
    "Nordland, winter, 2000 to 2299": ("nordland/summer", "nordland/winter", 2000, 2300),
    "IE Tower, frames 0 to 999": ("ie_tower", "ie_tower", 0, 1000),
    "IE Tower, frames 1000 to 1999": ("ie_tower", "ie_tower", 1000, 2000),
    "ESSEX3IN1": ("essex3in1/reference", "essex3in1/query", 0, 210),
}
#: drives in worlds other than that of the map
ELSEWHERE = {
    "Gardens Point": "nordland/winter", "Nordland": "gardens_point/night_right", "IE Tower": "nordland/winter",
    "ESSEX3IN1": "nordland/winter",
}  # fmt: skip
COLUMNS = (
    "within 2 images, %", "aside, m", "in 95 % regions, %", "lost, %", "off the map, %", "sure and wrong, %",
    "lost though right, %",
)  # fmt: skip


def photos(folder: Path, split: str, first: int, last: int, rows: int | None) -> tuple[ndarray, ndarray]:
    """Images in the order of their names, or those of ``split`` in ``labels.csv``, and their places in m.

    They are shrunk to ``rows`` rows, and have the size of the first.
    """
    paths = sorted(folder.iterdir())
    at = np.arange(len(paths))
    if (labels := folder / "labels.csv").is_file():
        labelled = list(csv.DictReader(labels.open()))
        at = np.flatnonzero([row["split"] == split for row in labelled])
        paths = [folder / labelled[number]["file"] for number in at]
    kept = (at >= first) & (at < last)
    opened = (Image.open(path).convert("RGB") for path, keep in zip(paths, kept, strict=True) if keep)
    if rows is not None:
        opened = (
            image.resize((round(image.width * rows / image.height), rows), Image.Resampling.BOX) for image in opened
        )
    images = list(opened)
    return np.stack([np.asarray(image.resize(images[0].size)) for image in images]), at[kept] - first


def descriptors(images: ndarray, poses: ndarray) -> Iterator[tuple[str, Localizer]]:
    """Localizers with the package's network, and with pixels."""
    yield "zoo:places", Localizer.from_images(images, poses, "zoo:places")
    yield "whitened PCA", Localizer.from_images(images, poses, WhitenedPCA(32, 48, min(128, len(images) // 2)))


def variants(images: ndarray, poses: ndarray) -> Iterator[tuple[str, Localizer]]:
    """The default, the default without each of its parts, and with pixels if its descriptor is the network's."""
    made = Localizer.from_images(images, poses)
    if made.descriptor.facts["kind"] == "network":
        yield "whitened PCA", Localizer.from_images(images, poses, WhitenedPCA(32, 48, min(128, len(images) // 2)))
    mapped = made.model.map
    smooth = CachedLocalGP(min(16, len(mapped)), map_evidence="mean").fit(mapped, fitted_kernel(mapped))
    alone = replace(made.filter, support=None)
    one_image = replace(made.filter, recovery=BayesRestart())
    for name, model, filter, adapts, odds in (
        ("default", made.model, made.filter, True, made.odds),
        ("without sharpening", smooth, made.filter, True, made.odds),
        ("without scale", made.model, made.filter, True, None),
        ("without both", smooth, made.filter, True, None),
        ("without adaptation", made.model, made.filter, False, None),
        ("without support", made.model, alone, True, made.odds),
        ("without window", made.model, one_image, True, made.odds),
    ):
        yield name, Localizer(
            model, made.likelihood, filter, radius=made.radius, descriptor=made.descriptor,
            image_size=made.image_size, adapts=adapts, odds=odds,
        )  # fmt: skip


def worse_odometry(images: ndarray, poses: ndarray) -> Iterator[tuple[str, Localizer, float | None, int]]:
    """The default, with the share of the motion reported by odometry and the number of steps standing at the end."""
    made = Localizer.from_images(images, poses)
    for name, scale, stands in (
        ("right in the mean", 1.0, 0),
        ("a tenth short", 0.9, 0),
        ("a tenth long", 1.1, 0),
        ("no odometry", None, 0),
        ("standing", 1.0, 40),
        ("half the way", 0.5, 0),
        ("half as far again", 1.5, 0),
        ("says it stands", 0.0, 0),
        ("the wrong way", -1.0, 0),
        ("elsewhere", 1.0, 0),
    ):
        yield name, made, scale, stands


def without_odometry(images: ndarray, poses: ndarray) -> Iterator[tuple[str, Localizer, float | None, int]]:
    """The default without odometry."""
    yield "no odometry", Localizer.from_images(images, poses), None, 0


def nearest(localizer: Localizer, seen: list[ndarray], places: ndarray, at: ndarray) -> float:
    """Share of the images, %, whose nearest map descriptor is within two images of their own place."""
    found = FlatIndex(np.asarray(localizer.model.map.descriptors), "euclidean").search(np.stack(seen), 1).indices[:, 0]
    return float(100 * (np.abs(places[found] - at) <= 2)[20 + JUDGED_FROM :].mean())


def drive(
    localizer: Localizer, seen: list[ndarray], at: ndarray, seed: int, scale: float | None = 1.0, stands: int = 0
) -> ndarray:
    """The columns, for one seed; ``seen`` are descriptors.

    Odometry reports ``scale`` times the motion (0: always zero motion; None: no odometry). The robot ``stands`` still
    for that many last steps.
    """
    localizer.reset(seed)
    rng, rows = np.random.default_rng(seed), []
    last = len(seen) - 1 - stands
    for step, number in enumerate(min(number, last) for number in range(20, len(seen))):
        ahead, aside, turn = rng.standard_normal(3) * (0.1, 0.02, 0.005)
        moved = at[number] - at[number - 1] if 20 + step <= last else 0.0
        motion = None if scale is None else (moved * (scale + ahead), moved * aside, moved * turn)
        motion = (0.0, 0.0, 0.0) if scale == 0 else motion
        told = localizer.step(motion, descriptor=seen[number])
        away = told.pose[:2] - (at[number], 0)
        inside = away @ np.linalg.solve(told.covariance[:2, :2] + 1e-12 * np.eye(2), away) < CHI2_95
        off_line = float(localizer.belief.weights[0] @ localizer.belief.poses[0, :, 1].abs())
        near = np.hypot(*away) <= 2
        sure = not (told.lost or near or inside)
        if step >= (len(seen) - 20 - stands // 2 if stands else JUDGED_FROM):
            judged = (inside, told.lost, told.off_map, sure, told.lost and near)
            rows.append((100 * near, off_line, *(100 * float(value) for value in judged)))
    return np.mean(rows, axis=0)


def elsewhere(localizer: Localizer, data: Path, walk: str) -> tuple[list[ndarray], ndarray]:
    """Descriptors of a drive through another world, and places far from those of the map."""
    folder = next(folder for name, folder in ELSEWHERE.items() if walk.startswith(name))
    images, at = photos(data / folder, "query", 0, 200, None)
    return [localizer.describe(image) for image in images], at - 1e6


def main() -> None:
    """Measure all walks."""
    chosen = parse_arguments(sys.argv[1:], KEYS, "python -m benchmarks.changed_walks seeds=8")
    seeds, rows = int(chosen.get("seeds", 8)), int(chosen["rows"]) if "rows" in chosen else None
    if (odometry := chosen.get("odometry", "")) not in ("", "true", "none"):
        sys.exit(f"odometry={odometry} must be true or none")
    data, table = Path(os.environ["SEXTANT_DATA"]), Table("walk", "localizer", *COLUMNS)
    for walk, (map_folder, query_folder, first, last) in WALKS.items():
        if not walk.startswith(chosen.get("walks", "")):
            continue
        images, places = photos(data / map_folder, "gallery", first, last, rows)
        seen, at = photos(data / query_folder, "query", first, last, rows)
        poses = np.zeros((len(images), 3))
        poses[:, 0] = places
        described: dict[int, tuple[SavedDescriptor, list[ndarray]]] = {}  # variants share a descriptor
        alone = {"true": worse_odometry, "none": without_odometry}.get(odometry)
        made = alone or (variants if rows is None else descriptors)
        for name, localizer, *driven in made(images, poses):
            key = id(localizer.descriptor)
            if key not in described:
                described[key] = localizer.descriptor, [localizer.describe(image) for image in seen]
                if made is without_odometry:
                    print(walk, f"nearest image {nearest(localizer, described[key][1], places, at):.0f}", flush=True)
            shown, where = (described[key][1], at) if name != "elsewhere" else elsewhere(localizer, data, walk)
            found = np.stack([drive(localizer, shown, where, seed, *driven) for seed in range(seeds)])
            low, high = share_interval(found[:, 0] / 100, trials=seeds)
            mean = found.mean(0)
            first_column = f"{mean[0]:.0f} [{100 * low:.0f}, {100 * high:.0f}]"
            table.add_row(walk, name, first_column, f"{mean[1]:.2f}", *(f"{value:.0f}" for value in mean[2:]))
            print(walk, name, first_column, mean.round(2), flush=True)
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
