"""The photos of a map and of queries; imports no torch."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from sextant.applications.arguments import check_apart
from sextant.chapters.places.cli.options import PlaceOptions
from sextant.chapters.places.photo_folder import HEADER, PhotoFolder, photos_below
from sextant.errors import UserError


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
    path = Path(given["map"]).expanduser()
    saved = (path / HEADER).is_file()
    reference = path if saved else photos_below(given["map"], "map", output, one=False)
    queries = photos_below(given["queries"], "queries", output)
    if isinstance(reference, PhotoFolder):
        refuse_overlap(reference, queries)
    check_apart(output, queries.paths, map=path, queries=given["queries"])
    return PlaceInputs(reference, queries, output, options)


def refuse_overlap(photos: PhotoFolder, queries: PhotoFolder) -> None:
    """Raise a ``UserError`` if a query is a file of the map, as finding itself would say nothing."""
    own = {os.path.realpath(path) for path in photos.paths}  # unlike Path.resolve, accepts a link to itself
    shared = [path for path in queries.paths if os.path.realpath(path) in own]
    if not shared:
        return
    first, second = photos.folder.resolve(), queries.folder.resolve()
    where = "are the same folder" if first == second else "share files, for one lies in the other"
    raise UserError(
        f"map={photos.folder} and queries={queries.folder} {where}: {len(shared):,} of {len(queries):,} queries are "
        f"files of the map, such as {shared[0].name}, and would find themselves",
        "Keep the two in folders side by side.",
    )
