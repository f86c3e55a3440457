"""The digest that identifies an experiment."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from sextant.moved import with_first_names

#: Keys that do not change the result: where it is computed and kept, how it is shown, how many processes load data.
NUISANCE = ("seed", "paths", "tracking", "sweep", "launcher", "reuse", "hydra")
NUISANCE_WITHIN = {"trainer": ("workers", "progress", "log_every"), "dataset": ("download",)}

#: keys that were added later, with the values that reproduce earlier behaviour and keep the digest of earlier runs
LATER: dict[str, dict[str, Any]] = {
    "trainer": {"accumulate": 1, "patience": None, "compile": False},
    "recovery": {"window": 0},
    "observation": {"rounded": False},
    "filter": {
        **{"outliers": None, "apart": None, "regions": None, "best": None, "adapts": False, "odds": None},
        "metric": None,
    },
    "kernel.sharper": {"heading": 1.0},
    "task": {"perspective_field": None, "geometric_height": 256},
    "task.whitening": {"images": 4000},
}


def identity(config: Mapping[str, Any]) -> dict[str, Any]:
    """The part of a resolved config that enters the digest, without the seed, which is a replicate of an experiment."""
    kept = {key: value for key, value in config.items() if key not in NUISANCE}
    for group, names in NUISANCE_WITHIN.items():
        if isinstance(kept.get(group), Mapping):
            kept[group] = {key: value for key, value in kept[group].items() if key not in names}
    for path, usual in LATER.items():
        kept = _without(kept, path.split("."), usual)
    found: dict[str, Any] = with_first_names(kept)
    return found


def _without(config: Mapping[str, Any], path: list[str], usual: Mapping[str, Any]) -> dict[str, Any]:
    """A config without those keys of the group at ``path`` that have their usual values."""
    if not path:
        return {key: value for key, value in config.items() if key not in usual or value != usual[key]}
    within = config.get(path[0])
    return {**config, path[0]: _without(within, path[1:], usual)} if isinstance(within, Mapping) else dict(config)


def digest(config: Mapping[str, Any]) -> str:
    """SHA-256 of the identity of a resolved config, in hexadecimal; directory names have its first eight digits."""
    canonical = json.dumps(identity(config), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode()).hexdigest()
