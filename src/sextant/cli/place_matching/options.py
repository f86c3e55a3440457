"""What a user may choose of the matching of places; imports nothing heavy."""

import math
from collections.abc import Mapping
from typing import get_args

from sextant.applications.places.options import KnownBy, PlaceOptions
from sextant.cli.arguments import one_of, whole
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
    return PlaceOptions(
        whole(given, "matches", 1) or PlaceOptions.matches,
        whole(given, "sequence", 2),
        one_of(given, "places", get_args(KnownBy)),
        _distance(given),
        one_of(given, "descriptors", ("false", "true")) == "true",
    )


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
