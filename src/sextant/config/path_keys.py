"""The keys of a config that name files or folders, and where a relative path among them starts."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

#: locations on this machine, which are never part of an experiment
PLACES = ("paths.data", "paths.outputs", "paths.cache")
#: keys whose value may also be a mapping, such as a file for each split
MAPPINGS = ("dataset.streets",)
#: all keys that name a file, a folder or a run
PATHS = (
    *PLACES,
    *MAPPINGS,
    *("dataset.folder", "dataset.sources.real.folder", "corruption.folder"),
    *("backbone.weights", "local.weights", "task.off_the_shelf.weights"),
    *("descriptor.folder", "descriptor.photo", "descriptor.network", "descriptor.run", "features.run", "init_from"),
)
#: what a key of weights may name in place of a file
KNOWN_WEIGHTS = ("imagenet",)


def from_where_it_ran(config: Mapping[str, Any]) -> dict[str, Any]:
    """A stored config with relative paths made absolute where they exist in the folder from which its run was started.

    A run is identified by its paths as written, so they are stored unchanged, with the folder they start from
    (``paths.here``; runs before Sextant 0.1.0 lack it). Paths that do not exist there, such as those within
    ``paths.data``, and those in ``paths`` itself are left unchanged.

    >>> stored = {"dataset": {"folder": "bin"}, "paths": {"here": "/usr"}}
    >>> from_where_it_ran(stored)["dataset"]
    {'folder': '/usr/bin'}
    """
    found, here = dict(config), str((config.get("paths") or {}).get("here") or "")
    for key in PATHS if here else ():
        if key not in PLACES:
            _make_absolute(found, key.split("."), Path(here))
    return found


def _make_absolute(node: dict[str, Any], key: list[str], here: Path) -> None:
    value = node.get(key[0])
    if len(key) > 1 and isinstance(value, Mapping):
        node[key[0]] = inner = dict(value)
        _make_absolute(inner, key[1:], here)
    elif len(key) == 1 and isinstance(value, str) and _may_be_path(key[0], value) and (here / value).exists():
        node[key[0]] = str(here / value)


def _may_be_path(name: str, value: str) -> bool:
    return not value.startswith("~") and not (name == "weights" and value in KNOWN_WEIGHTS)
