"""Similarities of photos of the same and of different places: ``python -m benchmarks.same_place data=<folder>``.

With the network of ``sextant demo``, on pairs of known places: Gardens Point by day and by
night, ESSEX3IN1, Nordland in summer and winter, some 200 places of each. Places more than ten photos apart are
different ones. Written into ``src/sextant/tools/demonstration/known_pairs.json``.
"""

import json
import sys
from pathlib import Path

import numpy as np

from sextant.applications.pixels import as_pixels
from sextant.atomic_files import write_atomically
from sextant.console.arguments import parse_arguments
from sextant.data.photo_files import find_photos
from sextant.tools.demonstration.same_place import KNOWN_PAIRS, SHARES, SamePlace

SETS = {
    "Gardens Point by day": ("gardens_point/day_left", "gardens_point/day_right"),
    "Gardens Point by night": ("gardens_point/day_right", "gardens_point/night_right"),
    "ESSEX3IN1": ("essex3in1/query", "essex3in1/reference"),
    "Nordland in winter": ("nordland/summer", "nordland/winter"),
}
PLACES, APART = 200, 10
KEYS = {"data": "folder of the sets"}
USAGE = "python -m benchmarks.same_place data=<folder>"


def main() -> None:
    data = Path(parse_arguments(sys.argv[1:], KEYS, USAGE)["data"])
    comparing = SamePlace.load()
    same, other = [], []
    for name, folders in SETS.items():
        pairs = list(zip(*(find_photos(str(data / folder), None) for folder in folders), strict=True))
        pairs = pairs[:: max(1, len(pairs) // PLACES)][:PLACES]
        first, second = (
            np.stack([as_pixels(path, comparing.size) for path in side]) for side in zip(*pairs, strict=True)
        )
        similarities = comparing.similarities(first, second)
        apart = np.abs(np.subtract.outer(*[np.arange(len(pairs))] * 2))
        same.append(similarities[apart == 0])
        other.append(similarities[apart > APART])
        print(f"{name}: {(same[-1][:, None] > other[-1]).mean():.2f} of same-place pairs more similar than others")
    quantiles = {
        name: np.quantile(np.concatenate(each), SHARES).round(3).tolist()
        for name, each in (("same", same), ("other", other))
    }
    told = json.dumps({"sets": list(SETS), **quantiles}) + "\n"
    write_atomically(KNOWN_PAIRS, lambda file: file.write(told.encode()))


if __name__ == "__main__":
    main()
