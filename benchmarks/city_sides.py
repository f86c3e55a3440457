"""The rank of the true place among a city's images, on the map's side of the street and on the other.

``python -m benchmarks.city_sides run=<run of task=place_recognition, or zoo:streets>``

The rank of the best image within 9 m and 30 degrees of the truth, by descriptors, for the frames of the validation
drives of ``dataset=town_city``, rendered first if necessary, at the network's input size. The map is in one lane:
a frame up to 3.5 m from an image counts as on its side, so that some midway between two images count as on the other.
Descriptors are cached with those of runs.
"""

import math
import sys

import numpy as np
from numpy import ndarray
from rich.console import Console
from rich.table import Table
from scipy.spatial import cKDTree

from sextant.chapters.localization.data.datamodule import LocalizationDataModule
from sextant.chapters.places.place_map import PlaceMap
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.console.arguments import parse_arguments
from sextant.errors import UserError
from sextant.registry import chapter_of

USAGE = "python -m benchmarks.city_sides run=<run>"
KEYS = {"run": "a run of place recognition, zoo:places or zoo:streets"}
NEAR_M, TURN, SAME_SIDE_M = 9.0, math.radians(30), 3.5


def ranks(seen: ndarray, at: ndarray, mapped: ndarray, places: ndarray, tree: cKDTree) -> ndarray:
    """The number of map images that are more similar to each frame than the best of its own place."""
    found = np.zeros(len(seen))
    for row, (vector, pose) in enumerate(zip(seen, at, strict=True)):
        near = np.array(tree.query_ball_point(pose[:2], NEAR_M), dtype=int)
        turned = np.abs((places[near, 2] - pose[2] + np.pi) % (2 * np.pi) - np.pi)
        alike = mapped @ vector
        found[row] = (alike > alike[near[turned < TURN]].max(initial=-np.inf)).sum()
    return found


def main() -> None:
    """Describe the city and rank all frames."""
    given = parse_arguments(sys.argv[1:], KEYS, USAGE)
    if "run" not in given:
        raise UserError("run= is missing: it names the network that describes the images", USAGE)
    run = given["run"]
    size = PlaceMap.load(run).size
    pictures = [f"dataset.width={size.width}", f"dataset.height={size.height}"]
    described = ["descriptor=run", f"descriptor.run={run}"]
    config = validate(to_plain(compose(["experiment=localization_city", *described, *pictures])))
    family = chapter_of("localization")
    data = family.data(config, family.source(config))
    assert isinstance(data, LocalizationDataModule)
    places, mapped = data.drives.map.poses, data.descriptors(data.drives.map)
    tree = cKDTree(places[:, :2])
    table = Table("drive", "frames on the map's side", "their median rank", "on the other side", "their median rank")
    for drive in data.drives.validation:
        poses = drive.poses
        found = ranks(data.descriptors(drive), poses, mapped, places, tree)
        same = tree.query(poses[:, :2])[0] <= SAME_SIDE_M
        cells = [(str(some.sum()), f"{np.median(found[some]):.0f}" if some.any() else "") for some in (same, ~same)]
        table.add_row(drive.condition, *cells[0], *cells[1])
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
