"""Two drives through a procedural town that are as hard to match as Nordland's summer and winter."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

PLACES = 2400
SETTINGS: dict[str, Any] = {}


def town_traverses(
    seed: int,
    cache: Path,
    *,
    places: int = PLACES,
    threads: int = 2,
    progress: Callable[[int, int], None] | None = None,
    **changes: Any,
) -> tuple[np.ndarray, np.ndarray]:
    """Summer and winter pictures of one town, uint8 (places, 32, 64, 3); rendered into a store below ``cache`` once.

    Args:
        seed: of the town and of both drives.
        cache: folder of stores.
        places: frames of a drive.
        threads: chunks rendered at a time.
        progress: called with the number of pictures that are rendered, and of all.
        changes: keys of ``dataset=town_seasons`` that are to differ from ``SETTINGS``.
    """
    from sextant.data.rendered import open_store
    from sextant.data.worlds import TownSeasons

    config = SETTINGS | changes | {"seed": seed, "frames": {"train": places, "val": 1, "test": 1}}
    store = open_store(TownSeasons(roots=[cache], **config).plan(), cache)
    split, condition, place = (store.columns[name] for name in ("split", "condition", "place"))
    drives = [np.flatnonzero((split == 0) & (condition == k)) for k in range(2)]
    if [place[drive].tolist() for drive in drives] != [list(range(places))] * 2:
        raise AssertionError("the drives are not aligned")
    store.fill(progress, threads)
    reference, query = (store.read("images", drive) for drive in drives)
    return reference, query
