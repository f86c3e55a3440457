"""Sets of real images of places, not used for training, and measures on them.

Gardens Point by day and by night (2 frames), Essex (equal names), two stretches of Nordland (1 of every tenth frame:
frames 1,650 to 2,399, which ``experiment=places_nordland`` does not train on), the floors of a tower (IE Tower: any of
2,373 images of a query's floor, by the authors' split, whose queries are frames of the same clips).

Intervals: bootstrap over blocks of 20 consecutive queries, 1,000 resamples.
"""

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32, UInt8
from numpy import ndarray

from sextant.baselines.place_descriptors import unit_norm
from sextant.data.image_files import decode_image
from sextant.evaluation.positives import Positives
from sextant.retrieval.without_mean import Centring, centred

BLOCK, DRAWS = 20, 1000
#: images described at a time
BATCH = 64
FLOORS = "ie_tower"


@dataclass(frozen=True)
class ImageSet:
    """Files of a map and of queries, and the map images at each query's place."""

    name: str
    family: str
    maps: list[Path]
    queries: list[Path]
    positives: Positives

    def read(self, height: int, width: int) -> tuple[UInt8[ndarray, "n h w c"], UInt8[ndarray, "m h w c"]]:
        """The images, stretched to one size."""
        maps, queries = (
            np.stack([decode_image(path, height, width, 3) for path in paths]) for paths in (self.maps, self.queries)
        )
        return maps, queries

    def described(self, describe: Callable[[ndarray], ndarray], height: int, width: int) -> "PlaceSet":
        """The set with descriptors; some images are held at a time."""
        rows = []
        for paths in (self.maps, self.queries):
            parts = [paths[start : start + BATCH] for start in range(0, len(paths), BATCH)]
            images = (np.stack([decode_image(path, height, width, 3) for path in part]) for part in parts)
            rows.append(unit_norm(np.concatenate([np.asarray(describe(some), np.float32) for some in images])))
        return PlaceSet(self.name, self.family, rows[0], rows[1], self.positives)


@dataclass(frozen=True)
class PlaceSet:
    """Descriptors of one set of images, rows of norm one before centring, and which of them show the same place."""

    name: str
    family: str
    reference: Float32[ndarray, "n d"]
    query: Float32[ndarray, "m d"]
    positives: Positives

    def similarities(self, centring: Centring = "none") -> Float32[ndarray, "m n"]:
        reference, query = centred(self.reference, self.query, centring)
        return np.asarray(query @ reference.T)


def image_sets(data: Path, *, floors: bool = False, corridor: bool = False) -> list[ImageSet]:
    """The sets of places; with ``floors`` the tower's as well, and with ``corridor`` that of a robot's two rounds."""
    found = []
    for name, family, queries, references in (
        ("Gardens Point, day", "gardens_point", "day_left", "day_right"),
        ("Gardens Point, night", "gardens_point", "night_right", "day_right"),
        ("Essex", "essex3in1", "query", "reference"),
    ):
        root = data / family
        maps = sorted((root / references).iterdir())
        number = {f"{references}/{path.name}": i for i, path in enumerate(maps)}
        rows = [(row["query"], row["references"].split()) for row in _table(root / "ground_truth.csv")]
        rows = [row for row in rows if row[0].startswith(f"{queries}/") and all(each in number for each in row[1])]
        near = [[number[each] for each in row[1]] for row in rows]
        positives = Positives.from_lists(near, len(maps))
        found.append(ImageSet(name, family, maps, [root / row[0] for row in rows], positives))
    summer, winter = (sorted((data / "nordland" / season).iterdir()) for season in ("summer", "winter"))
    for name, first, end in (("Nordland, 1,650 on", 1650, 2025), ("Nordland, 2,025 on", 2025, 2400)):
        frames = np.arange(end - first)
        positives = Positives.within_frames(frames, frames, 1)
        found.append(ImageSet(name, "nordland", summer[first:end], winter[first:end], positives))
    found += [_corridor(data / "corridor_twice")] if corridor else []
    return [*found, _floors(data / FLOORS)] if floors else found


def _corridor(root: Path) -> ImageSet:
    """Queries whose place is in the map, 2 frames."""
    maps = sorted((root / "map").iterdir())
    number = {path.stem: i for i, path in enumerate(maps)}
    rows = [(row["query"], row["map_matches"].split()) for row in _table(root / "ground_truth.csv")]
    rows = [row for row in rows if row[1]]
    positives = Positives.from_lists([[number[each] for each in row[1]] for row in rows], len(maps))
    return ImageSet("Corridor", "corridor_twice", maps, [root / row[0] for row in rows], positives)


def _floors(root: Path) -> ImageSet:
    rows = _table(root / "labels.csv")
    parts = [[row for row in rows if (row["split"] == "gallery") == of_map] for of_map in (True, False)]
    floors = [np.array([row["floor"] for row in part]) for part in parts]
    files = [[root / row["file"] for row in part] for part in parts]
    return ImageSet("IE Tower, floor", FLOORS, *files, Positives.from_mask(floors[1][:, None] == floors[0]))


def _table(file: Path) -> list[dict[str, str]]:
    with file.open() as lines:
        return list(csv.DictReader(lines))


def in_batches(describe: Callable[[ndarray], ndarray], images: ndarray) -> Float32[ndarray, "n d"]:
    """Descriptors of many images."""
    parts = [images[start : start + BATCH] for start in range(0, len(images), BATCH)]
    return np.concatenate([np.asarray(describe(part), np.float32) for part in parts])


def hits(similarities: ndarray, positives: Positives, k: int = 1) -> Bool[ndarray, "m"]:
    """Whether one of the k best matches is right."""
    best = np.argsort(-similarities, axis=1, kind="stable")[:, :k]
    return np.asarray(positives.hits(best).any(axis=1))


def interval(values: Sequence[float] | ndarray) -> tuple[float, float]:
    """The 95 % interval of a mean over consecutive queries."""
    values = np.asarray(values, np.float64)
    rng, blocks = np.random.default_rng(0), np.array_split(values, max(1, len(values) // BLOCK))
    drawn = rng.integers(len(blocks), size=(DRAWS, len(blocks)))
    totals, counts = np.array([block.sum() for block in blocks]), np.array([len(block) for block in blocks])
    means = totals[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return float(low), float(high)
