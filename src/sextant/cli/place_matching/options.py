"""What a user may choose of the matching of places; imports nothing but the standard library."""

import math
from collections.abc import Mapping
from typing import get_args

from sextant.applications.places.options import KnownBy, PlaceOptions
from sextant.errors import UserError

INPUTS = {
    "map": "folder of photos whose places are known, or one that descriptors=true wrote: <output>/map",
    "queries": "a photo, or a folder of photos, that are looked up in the map",
}
KEYS = {
    "matches": "how many matches of each query are told; 5 unless given",
    "sequence": "the queries are a ride in the order of their names: match by sequences of so many photos too",
    "places": "how the truth is known, as in dataset=place_folders: none (default), csv, utm, name or order",
    "tolerance": "largest distance of one place: in metres for places=csv and utm, else in files; unless given that of "
    "the run's test, and 0 files for places=none",
    "descriptors": "true: keep the descriptors, so that the map can be used again",
}


def options_from(given: Mapping[str, str]) -> PlaceOptions:
    """Read the keys of :data:`KEYS`.

    Raises:
        UserError: a value is not one of those allowed.
    """
    for key, allowed in (("places", get_args(KnownBy)), ("descriptors", ("false", "true"))):
        if given.get(key, allowed[0]) not in allowed:
            raise UserError(
                f"{key}={given[key]} must be one of {', '.join(allowed)}", f"For example {key}={allowed[1]}"
            )
    return PlaceOptions(
        _whole(given, "matches", 1) or PlaceOptions.matches,
        _whole(given, "sequence", 2),
        given.get("places", "none"),  # type: ignore[arg-type]  # checked above
        _distance(given),
        given.get("descriptors") == "true",
    )


def _whole(given: Mapping[str, str], key: str, least: int) -> int | None:
    if key not in given:
        return None
    if not (given[key].isascii() and given[key].isdigit() and int(given[key]) >= least):
        raise UserError(f"{key}={given[key]} must be a whole number from {least} up", f"For example {key}=10")
    return int(given[key])


def _distance(given: Mapping[str, str]) -> float | None:
    if "tolerance" not in given:
        return None
    try:
        value = float(given["tolerance"])
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 0):
        raise UserError(f"tolerance={given['tolerance']} must be a number from 0 up", "For example tolerance=5")
    return value
