"""Options of place matching; imports nothing heavy."""

from typing import Literal

from pydantic import Field

from sextant.chapters.places.photo_folder import KnownBy
from sextant.console.arguments import Options

INPUTS = {
    "map": "folder of photos whose places are known, or one that descriptors=true wrote: <output>/map",
    "queries": "a photo, or a folder of photos, that are looked up in the map",
}


class PlaceOptions(Options):
    """What the user chose."""

    matches: int = Field(5, ge=1, examples=[10])
    """number of matches to show for each query (default: 5)"""
    sequence: int | None = Field(None, ge=2, examples=[10])
    """match by sequences of so many photos too; the queries are one traverse in the order of their names"""
    places: KnownBy = Field("none", examples=["csv"])
    """how the ground truth is known, as in dataset=place_folders: none (default), csv, utm, gps, name or order"""
    tolerance: float | None = Field(None, ge=0, examples=[5])
    """largest distance within one place: metres for places=csv, utm and gps, else files (default: that of the run's
    test, and 0 files for places=none)"""
    centring: Literal["none", "running", "all"] = Field("none", examples=["all"])
    """subtract the mean descriptor of the map, and that of all queries (all) or of those so far (running): what light
    and season add to one traverse (default: none)"""
    descriptors: bool = Field(False, examples=["true"])
    """true: keep the descriptors, so that the map can be used again"""
    colmap: bool = Field(False, examples=["true"])
    """true: also write each query with its matches to <output>/pairs.txt, for COLMAP's matches_importer"""
