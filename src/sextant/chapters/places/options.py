"""Options and inputs of place matching; imports no torch."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator

from sextant.applications.arguments import check_apart
from sextant.chapters.places.photo_folder import HEADER, KnownBy, PhotoFolder, photos_below
from sextant.console.arguments import Options
from sextant.errors import UserError
from sextant.tables import counted

INPUTS = {
    "map": "folder of photos of known places, or <output>/map as written with descriptors=true",
    "queries": "a photo or folder of photos to look up in the map",
}


class PlaceOptions(Options):
    """Options chosen by the user."""

    matches: int = Field(5, ge=1, examples=[10])
    """number of matches to show for each query (default: 5)"""
    sequence: int | None = Field(None, ge=2, examples=[10])
    """also match sequences of this length; the queries must be one traverse in order of file name"""
    rerank: int | None = Field(None, ge=1, examples=[15])
    """number of best matches to re-rank by local features shared with the query (default: none)"""
    local: str = Field("xfeat", examples=["trunk"])
    """the local features for rerank: xfeat (default), trunk (the activations of the run's network), aliked:<folder of
    its weights>, or none"""
    places: KnownBy = Field("none", examples=["csv"])
    """source of the ground truth, as in dataset=place_folders: none (default), csv, utm, gps, name or order"""
    tolerance: float | None = Field(None, ge=0, examples=[5])
    """largest distance within one place: metres for places=csv, utm and gps, otherwise files (default: that of the
    run's test, or 0 files for places=none)"""
    centring: Literal["none", "running", "all"] = Field("none", examples=["all"])
    """all or running: subtract the mean descriptor of the map, and that of all queries or of the queries up to now, to
    remove the effect of light and season on a traverse (default: none)"""
    descriptors: str = Field("false", title="true, false or <map>.npy,<queries>.npy", examples=["true"])
    """true: save the descriptors of the map for reuse; or, instead of run=, those computed elsewhere:
    <map>.npy,<queries>.npy, one row per photo in the order of names"""
    colmap: bool = Field(False, examples=["true"])
    """true: also write the pairs of queries and matches to <output>/pairs.txt, for COLMAP's matches_importer"""

    @field_validator("descriptors")
    @classmethod
    def _kept_or_given(cls, value: str) -> str:
        if value in ("true", "false") or [Path(each).suffix for each in value.split(",")] == [".npy"] * 2:
            return value
        raise ValueError("true, false or two files")

    @property
    def keep(self) -> bool:
        """Whether descriptors are saved."""
        return self.descriptors == "true"

    @property
    def given(self) -> Mapping[str, Path]:
        """Files of descriptors computed elsewhere, of the map and of the queries; empty without any."""
        if self.descriptors in ("true", "false"):
            return {}
        return dict(zip(INPUTS, (Path(each.strip()).expanduser() for each in self.descriptors.split(",")), strict=True))


@dataclass(frozen=True)
class PlaceInputs:
    """The inputs of place matching.

    Attributes:
        reference: photos of the map, or the folder of their saved descriptors.
        queries: photos to look up.
        output: folder for the results.
        options: options chosen by the user.
    """

    reference: PhotoFolder | Path
    queries: PhotoFolder
    output: Path
    options: PlaceOptions


def read_inputs(given: Mapping[str, str]) -> PlaceInputs:
    """Read the inputs from the arguments.

    Raises:
        UserError: an option is invalid, a folder does not exist or has no photos, or queries are files of the map.
    """
    options, output = PlaceOptions.of(given), Path(given.get("output", "matches")).expanduser()
    if options.rerank is None and "local" in options.model_fields_set and options.local != "none":
        raise UserError(f"local={options.local} is for rerank=, which is not given", f"rerank=15 local={options.local}")
    path = Path(given["map"]).expanduser()
    saved = (path / HEADER).is_file()
    if saved and options.given:
        raise UserError(
            f"map={path} holds descriptors already; descriptors={options.descriptors} are those of photos",
            "Give the folder of the map's photos.",
        )
    reference = path if saved else photos_below(given["map"], "map", output, one=False)
    queries = photos_below(given["queries"], "queries", output)
    if options.sequence is not None and options.sequence > len(queries):
        raise UserError(
            f"sequence={options.sequence} is above the number of queries, {len(queries):,}", "Leave out sequence=."
        )
    if isinstance(reference, PhotoFolder):
        refuse_overlap(reference, queries)
    check_apart(output, queries.paths, map=path, queries=given["queries"])
    return PlaceInputs(reference, queries, output, options)


def refuse_overlap(photos: PhotoFolder, queries: PhotoFolder) -> None:
    """Raise a ``UserError`` if a query is also a file of the map, since it would be its own match."""
    own = {os.path.realpath(path) for path in photos.paths}  # unlike Path.resolve, accepts a link to itself
    shared = [path for path in queries.paths if os.path.realpath(path) in own]
    if not shared:
        return
    first, second = photos.folder.resolve(), queries.folder.resolve()
    where = "are the same folder" if first == second else "share files, because one lies in the other"
    raise UserError(
        f"map={photos.folder} and queries={queries.folder} {where}: {len(shared):,} of "
        f"{counted(len(queries), 'query', 'queries')} {'is' if len(shared) == 1 else 'are'} in the map as well, such "
        f"as {shared[0].name}; each would match itself",
        "Put map and queries into separate folders.",
    )
