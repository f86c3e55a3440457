"""Recall of place matches without and with re-ranking by inliers, and what it costs.

``python -m benchmarks.reranking [run=zoo:places] [sets=<name>,...] [side=320,640] [every=1] [data=<folder>]``

The sets are those of :mod:`benchmarks.place_sets`, whose intervals are used; the rule was developed on Gardens Point by
day. *Always the most* takes the candidate with the most inliers whatever the retrieval answers. CPU seconds are of one
query: its features, and its matches with 15 candidates, whose features are in memory. Run it with OMP_NUM_THREADS=1.
"""

import os
import sys
from pathlib import Path
from time import process_time
from typing import NamedTuple

import numpy as np
import torch
from numpy import ndarray
from rich.console import Console
from rich.table import Table

from benchmarks.machine import describe_machine
from benchmarks.place_sets import ImageSet, image_sets, interval
from sextant.chapters.places.place_map import PlaceMap
from sextant.chapters.places.reranked_matches import PhotoFeatures
from sextant.console.arguments import parse_arguments
from sextant.correspondence import XFeatures
from sextant.correspondence.reranking import count_inliers, reranked

USAGE = "python -m benchmarks.reranking [run=zoo:places] [sets=<name>,...] [side=320,640] [every=1] [data=<folder>]"
KEYS = {
    "run": "a run of place recognition (default: zoo:places)",
    "sets": "beginnings of the names of sets, separated by commas (default: all)",
    "side": "longer sides to which images are scaled for their local features (default: 320,640)",
    "every": "take one of so many queries (default: 1)",
    "data": "SEXTANT_DATA by default",
}
CANDIDATES = 15


class Counted(NamedTuple):
    """The candidates of each query in the order of the retrieval, with their cost in CPU seconds.

    That of a map photo is nan where the features of all were in memory.
    """

    right: ndarray
    inliers: ndarray
    per_query: float
    per_photo: float


def main(arguments: list[str]) -> None:
    given = parse_arguments(arguments, KEYS, USAGE)
    torch.set_num_threads(1)
    places = PlaceMap.load(given.get("run", "zoo:places"))
    begins = tuple(given["sets"].split(",")) if "sets" in given else ("",)
    chosen = image_sets(Path(given.get("data", os.environ.get("SEXTANT_DATA", "data"))))
    table = Table(
        *("set", "side", "queries", "R@1", "re-ranked", "gain", "won, lost", "always the most", "lost"),
        *(f"R@{CANDIDATES}", "CPU s a query", "CPU s a map photo"),
    )
    for side in map(int, given.get("side", "320,640").split(",")):
        features = PhotoFeatures(XFeatures(side=side))
        for each in chosen:
            if each.name.startswith(begins):
                cells = row(counted(each, places, features, int(given.get("every", "1"))))
                table.add_row(each.name, str(side), *cells)
                print(each.name, side, *cells, sep=" | ", file=sys.stderr)
    console = Console(width=200)
    console.print(table)
    console.print(describe_machine())


def counted(each: ImageSet, places: PlaceMap, features: PhotoFeatures, every: int) -> Counted:
    """Candidates of each query with their inliers."""
    describer, size = places.descriptor.describer, places.size
    assert describer is not None
    similarities = each.described(describer.describe, size.height, size.width).similarities()
    order = np.argsort(-similarities, axis=1, kind="stable")[:, :CANDIDATES]
    queries = range(0, len(order), every)
    needed = np.unique(order[queries]).tolist()
    hits = features.of_file.cache_info().hits
    start = process_time()
    for image in needed:
        features.of_file(each.maps[image])
    seconds = process_time() - start
    fresh = len(needed) - (features.of_file.cache_info().hits - hits)
    start = process_time()
    inliers = [
        count_inliers(
            features.of(each.queries[i]), [features.of_file(each.maps[image]) for image in order[i]], side=features.side
        )
        for i in queries
    ]
    per_query = (process_time() - start) / len(queries)
    right = np.asarray(each.positives.hits(order))[queries]
    return Counted(right, np.array(inliers), per_query, seconds / fresh if fresh else np.nan)


def row(found: Counted) -> list[str]:
    """Recall with its interval in per cent, and numbers of queries whose first answer became right or wrong."""
    before = found.right[:, 0]
    numbers = np.arange(len(before))
    after = found.right[numbers, [reranked(each)[0] for each in found.inliers]]
    always = found.right[numbers, found.inliers.argmax(axis=1)]
    low, high = interval(100 * (after.astype(float) - before))
    return [
        str(len(before)),
        *(_recall(each) for each in (before, after)),
        f"{100 * (after.mean() - before.mean()):+.1f} [{low:+.1f}, {high:+.1f}]",
        f"{(after & ~before).sum()}, {(before & ~after).sum()}",
        f"{100 * always.mean():.1f}",
        str((before & ~always).sum()),
        f"{100 * found.right.any(axis=1).mean():.1f}",
        f"{found.per_query:.2f}",
        "–" if np.isnan(found.per_photo) else f"{found.per_photo:.2f}",
    ]


def _recall(right: ndarray) -> str:
    low, high = interval(100.0 * right)
    return f"{100 * right.mean():.1f} [{low:.1f}, {high:.1f}]"


if __name__ == "__main__":
    main(sys.argv[1:])
