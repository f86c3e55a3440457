"""Two drives through a procedural town, made to be as hard to match as Nordland's summer and winter.

The comparison is in ``results/worlds.md``.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from sextant.composing.compose import compose, to_plain
from sextant.data.rendered import open_store
from sextant.data.worlds.towns import TownSeasons, TownSeasonsPlan, town_seed
from sextant.worlds.town import Town

PLACES = 2400
#: a block within this distance of a camera counts as beside it
BESIDE_M = 15.0
#: differences from ``dataset=town_seasons``, and ``built_up``, 0 to 1: how built-up the blocks along the drive are
SETTINGS: dict[str, Any] = {
    "width": 64,
    "height": 32,
    "vfov_deg": 60.0,
    "samples": 9,
    "step_m": 6.0,
    "lateral_sigma_m": 0.08,
    "heading_sigma_deg": 1.4,
    "block_m": 90.0,
    "built_up": 0.36,
    "conditions": [
        {
            "name": "summer",
            "condition": "summer_noon",
            "sun_elevation_deg": 49,
            "sun_azimuth_deg": 150,
            "read_noise": 0.005,
        },
        {"name": "winter", "condition": "winter_noon", "cloud_cover": 0.9, "cars_moved": 0.1, "read_noise": 0.005},
    ],
}


class NordlandTownPlan(TownSeasonsPlan):
    """Drives past blocks that are equally built-up in every town; the dataset draws the density of a town.

    Statistics depend on density more than on anything else that differs between seeds: facades are easily
    distinguished, gardens are not.
    """

    def density(self, scene: int) -> float:
        """The density at which the blocks beside the cameras have the mean ``built_up``."""
        town = Town(self.graph(scene), town_seed(self.config["seed"], scene), density=0.5)
        cameras = shapely.points(self.shots.pose[self.shots.scene == scene, :2])
        near = shapely.STRtree(town.ground.blocks).query(cameras, predicate="dwithin", distance=BESIDE_M)[1]
        drawn = np.maximum(town.districts[near], 0).mean()  # parks are -1
        return float(np.clip(0.5 + self.config["built_up"] - drawn, 0.1, 0.95))


class NordlandTown(TownSeasons):
    """Drives through a town; see ``SETTINGS``."""

    name = "nordland_town"
    plan_type = NordlandTownPlan


def town_traverses(
    seed: int,
    cache: Path,
    *,
    places: int = PLACES,
    threads: int = 2,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Summer and winter pictures of one town, uint8 (places, 32, 64, 3); rendered into a store below ``cache`` once.

    Args:
        seed: of the town and of both drives.
        cache: folder of stores.
        places: frames of a drive.
        threads: chunks rendered at a time.
        progress: called with the number of pictures that are rendered, and of all.
    """
    base = to_plain(compose(["dataset=town_seasons"]))["dataset"]
    base.pop("_target_")
    config = base | SETTINGS | {"seed": seed, "frames": {"train": places, "val": 1, "test": 1}}
    store = open_store(NordlandTown(roots=[cache], **config).plan(), cache)
    store.fill(progress, threads)
    split, condition = store.columns["split"], store.columns["condition"]
    reference, query = (store.read("images", np.flatnonzero((split == 0) & (condition == k))) for k in range(2))
    return reference, query
