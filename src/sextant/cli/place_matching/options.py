"""Options of place matching; imports nothing heavy."""

from typing import Literal

from pydantic import Field

from sextant.applications.places.photo_folder import KnownBy
from sextant.cli.arguments import Options

INPUTS = {
    "map": "folder of photos whose places are known, or one that descriptors=true wrote: <output>/map",
    "queries": "a photo, or a folder of photos, that are looked up in the map",
}


class PlaceOptions(Options):
    """What the user chose."""

    matches: int = Field(5, ge=1, examples=[10])
    """how many matches of each query are shown; 5 unless given"""
    sequence: int | None = Field(None, ge=2, examples=[10])
    """the queries are a ride in the order of their names: match by sequences of so many photos too"""
    places: KnownBy = Field("none", examples=["csv"])
    """how the truth is known, as in dataset=place_folders: none (default), csv, utm, gps, name or order"""
    tolerance: float | None = Field(None, ge=0, examples=[5])
    """largest distance of one place: in metres for places=csv, utm and gps, else in files; unless given that of the
    run's test, and 0 files for places=none"""
    centring: Literal["none", "running", "all"] = Field("none", examples=["all"])
    """the queries are of one ride: take away the mean descriptor of the map, and that of all queries (all) or of those
    so far (running), which is what light and season add; none unless given"""
    descriptors: bool = Field(False, examples=["true"])
    """true: keep the descriptors, so that the map can be used again"""
    colmap: bool = Field(False, examples=["true"])
    """true: each query with its matches in <output>/pairs.txt too, for COLMAP's matches_importer"""
