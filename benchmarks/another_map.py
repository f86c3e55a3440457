"""Whether drives are told from drives in another map: ``python -m benchmarks.another_map csv=pairs.csv``.

Maps of real places, and drives through each of them, described by ``zoo:places`` in one size, and by whitened principal
components where another season of one railway is the drive. Each is compared with each by the mean recognition of its
images (``Localizer.recognised``); a drive below the threshold is *not in this map*. Floors of one tower are compared
with themselves and with other sets, but not with each other, which look alike. A drive is judged as a whole and in
stretches of 20 images.
"""

import csv
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from numpy import ndarray
from PIL import Image

from benchmarks.changed_walks import WALKS, photos
from sextant import Localizer
from sextant.console.arguments import parse_arguments
from sextant.localization.constants import RECOGNISED
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.recognition import MapRecognition

KEYS = {"csv": "a file for the result of each pair"}
SIZE, STRETCH = (160, 120), 20
#: folder, first image, step and most images, of the map and of drives through it
SETS = {
    "gardens": [("gardens_point/day_left", 0, 3, 66), ("gardens_point/day_right", 1, 3, 60),
                ("gardens_point/night_right", 1, 3, 60)],
    "gardens, all": [("gardens_point/day_left", 0, 1, 200), ("gardens_point/day_right", 0, 1, 200),
                     ("gardens_point/night_right", 0, 1, 200)],
    "corridors": [("corridor_twice/map", 0, 1, 60), ("corridor_twice/query", 0, 1, 60)],
    "essex": [("essex3in1/reference", 0, 1, 100), ("essex3in1/query", 0, 2, 50)],
    "castle": [("strecha_posed/castle", 0, 2, 15), ("strecha_posed/castle", 1, 2, 15)],
    "fountain": [("strecha_posed/fountain", 0, 1, 11)],
}  # fmt: skip
FLOORS = ("f06_hallway_alt", "f09_hallway_alt", "f11_hallway_right", "f22_cafeteria_main")


def sets(data: Path) -> Iterator[tuple[str, list[list[Path]]]]:
    """The name of each place, and the files of its map and drives."""
    for name, parts in SETS.items():
        found = []
        for start, first, step, count in parts:
            folder, begins = (start, "") if (data / start).is_dir() else start.rsplit("/", 1)
            found.append(sorted((data / folder).glob(f"{begins}*.jpg"))[first::step][:count])
        yield name, found
    with (data / "ie_tower" / "labels.csv").open() as file:
        rows = list(csv.DictReader(file))
    for video in FLOORS:
        files = [data / "ie_tower" / row["file"] for row in rows if row["video"] == video][:120]
        yield f"tower {video}", [files[::2], files[1::4]]


def opened(paths: list[Path]) -> ndarray:
    """Photos of one size."""
    return np.stack([np.asarray(Image.open(path).convert("RGB").resize(SIZE)) for path in paths])


def line(count: int) -> ndarray:
    """Poses a metre apart."""
    return np.column_stack([np.arange(float(count)), np.zeros((count, 2))])


def pairs(data: Path) -> Iterator[tuple[str, str, bool, MapRecognition, torch.Tensor]]:
    """Map, drive, whether the drive is of the map's place, and what they look like."""
    described, localizer = {}, None
    for name, (mapped, *drives) in sets(data):
        if localizer is None:
            localizer = Localizer.from_images(opened(mapped[:12]), line(12), "zoo:places", steps=0)
        described[name] = [
            torch.from_numpy(np.stack([localizer.describe(image) for image in opened(paths)]))
            for paths in (mapped, *drives)
        ]
        print("described", name, flush=True)
    for name, (mapped, *_) in described.items():
        known = MapRecognition.of(DescriptorMap.of(torch.from_numpy(line(len(mapped))), mapped))
        for other, (_, *drives) in described.items():
            if known is None or (name != other and name.split()[0].strip(",") == other.split()[0].strip(",")):
                continue
            for number, seen in enumerate(drives or described[other][:1]):
                yield name, f"{other}, drive {number + 1}", name == other, known, seen
    for walk, (map_folder, query_folder, first, last) in WALKS.items():
        if walk.startswith("Nordland"):
            images, places = photos(data / map_folder, "gallery", first, last, None)
            made = Localizer.from_images(images, np.column_stack([places, np.zeros((len(places), 2))]), steps=0)
            winter = photos(data / query_folder, "query", first, last, None)[0]
            seen = torch.from_numpy(np.stack([made.describe(image) for image in winter]))
            known = MapRecognition.of(made.model.map)
            assert known is not None
            yield "railway", walk, True, known, seen


def main() -> None:
    """Measure all pairs."""
    chosen = parse_arguments(sys.argv[1:], KEYS, "python -m benchmarks.another_map csv=pairs.csv")
    rows = []
    for name, drive, own, known, seen in pairs(Path(os.environ["SEXTANT_DATA"])):
        parts = seen.split(STRETCH)
        short = [known.of_drive(part) for part in parts if len(part) == STRETCH]
        rows.append((name, drive, own, known.of_drive(seen), sum(one < RECOGNISED for one in short), len(short)))
        if own:
            print(f"{name} <- {drive}: {rows[-1][3]:.2f}; stretches missed {rows[-1][4]} of {len(short)}", flush=True)
    for own, says in ((True, "of the map's own place"), (False, "of other places")):
        told = [row for row in rows if row[2] == own]
        below, short, all_short = (
            sum(values) for values in zip(*((row[3] < RECOGNISED, *row[4:]) for row in told), strict=True)
        )
        print(f"not in this map, drives {says}: {below} of {len(told)}; stretches of {STRETCH}: {short} of {all_short}")
    print("most alike:", *(f"{row[0]} <- {row[1]} {row[3]:.2f};" for row in sorted(
        (row for row in rows if not row[2]), key=lambda row: -row[3])[:6]))  # fmt: skip
    if "csv" in chosen:
        with open(chosen["csv"], "w", newline="") as file:
            csv.writer(file).writerows([("map", "drive", "own", "recognised", "stretches_below", "stretches"), *rows])


if __name__ == "__main__":
    main()
