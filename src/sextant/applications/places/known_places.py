"""Which map images show one place, and, where the truth is known, which of them show the place of a query."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int64
from numpy import ndarray
from scipy.spatial import cKDTree

from sextant.applications.places.describing import DescribedPhotos
from sextant.applications.places.options import PlaceOptions
from sextant.applications.places.photo_folder import PhotoFolder
from sextant.data.places import ImageRows, PlaceImages, PlaceTolerance
from sextant.data.places.image_files import natural_key
from sextant.data.places.pose_files import Pose, table_poses, utm_poses
from sextant.data.places.tolerance import Unit
from sextant.errors import UserError
from sextant.evaluation.places.positives import Positives

TABLE = "poses.csv"
#: frames between two folders of one map: no tolerance spans them
BETWEEN_FOLDERS = 10**9


@dataclass(frozen=True)
class KnownPlaces:
    """Who shows the same place.

    Attributes:
        tolerance: what counts as one place.
        same_place: of each map image the map images of its place, itself left out or not.
        positives: of each query the map images of its place; None where the truth is not known.
        remark: what the user should know of it, or "".
    """

    tolerance: PlaceTolerance
    same_place: Positives
    positives: Positives | None
    remark: str = ""


def same_place(described: DescribedPhotos, tolerance: float) -> Positives:
    """Of each photo of a map the photos of its place, itself among them.

    Args:
        described: the map.
        tolerance: largest distance of one place: in metres between positions; of a map without any, in photos of one
            folder in the order of the map.
    """
    if described.positions is None:
        frames = _ride_frames(described.photos.names)[described.rows]
        return Positives.within_frames(frames, frames, math.floor(min(tolerance, BETWEEN_FOLDERS - 1)))
    known = np.flatnonzero(~np.isnan(described.positions).any(axis=1))
    near: list[Any] = [[i] for i in range(len(described.index))]
    if len(known):
        tree = cKDTree(described.positions[known])
        for i, found in zip(known, tree.query_ball_tree(tree, tolerance), strict=True):
            near[i] = known[found]
    return Positives.from_lists(near, len(near))


def known_places(
    reference: DescribedPhotos,
    queries: DescribedPhotos,
    options: PlaceOptions,
    tolerances: Mapping[Unit, PlaceTolerance],
) -> KnownPlaces:
    """What ``places=`` and ``tolerance=`` tell of the photos that have descriptors.

    Args:
        reference: the map.
        queries: to be looked up.
        options: chosen by the user.
        tolerances: of the run's test, by unit, for what the user left open.

    Raises:
        UserError: the photos do not have what ``places=`` names: a table, names, equal numbers.
    """
    unit: Unit = "m" if options.places in ("csv", "utm") else "frames"
    tolerance = tolerances[unit]
    chosen = 0.0 if options.tolerance is None and options.places == "none" else options.tolerance
    if chosen is not None:
        tolerance = replace(
            tolerance, positive=chosen, negative=max(tolerance.negative, math.nextafter(chosen, math.inf))
        )
    if options.places == "none":
        along_the_ride = replace(reference, positions=None)
        return KnownPlaces(tolerance, same_place(along_the_ride, tolerance.positive), None)
    images = _placed(reference.photos, queries.photos, options)
    remark = ""
    if images.heading_deg is None and tolerance.heading_deg is not None:
        tolerance, remark = replace(tolerance, heading_deg=None), "headings are not known, so none were compared"
    of_map, of_queries = reference.rows, len(reference.photos) + queries.rows
    same = Positives.from_sparse(images.positives(of_map, of_map, tolerance))
    return KnownPlaces(tolerance, same, Positives.from_sparse(images.positives(of_queries, of_map, tolerance)), remark)


def check_truth(reference: PhotoFolder, queries: PhotoFolder, options: PlaceOptions) -> None:
    """Raise a ``UserError`` if the photos lack what ``places=`` names; told before any of them is described."""
    if options.places != "none":
        _placed(reference, queries, options)


def _placed(reference: PhotoFolder, queries: PhotoFolder, options: PlaceOptions) -> PlaceImages:
    """The places of all photos, the map's first; no pixels."""
    both = (("map", reference), ("queries", queries))
    frames = np.concatenate([np.arange(len(photos)) for _, photos in both])
    positions, headings = None, None
    if options.places == "name":
        frames = _name_frames(reference.names, queries.names)
    elif options.places == "order":
        if len(reference) != len(queries):
            raise UserError(
                f"places=order takes the i-th photos of both folders for one place, but map={reference.folder} has "
                f"{len(reference):,} and queries={queries.folder} has {len(queries):,}",
                "Remove what has no partner, or use equal names (places=name) or poses (places=csv or utm).",
            )
    else:
        poses = [pose for key, photos in both for pose in _poses(key, photos, options)]
        positions = np.array([(pose.x, pose.y) for pose in poses])
        angles = [pose.heading_deg for pose in poses if pose.heading_deg is not None]
        headings = np.array(angles) if len(angles) == len(poses) else None
    return PlaceImages(
        ImageRows(np.zeros((len(frames), 0, 0, 0), np.uint8)),
        np.repeat([0, 1], [len(reference), len(queries)]),
        ("map", "queries"),
        frames,
        (*reference.names, *queries.names),
        positions,
        headings,
        aligned=positions is None,
    )


def _poses(key: str, photos: PhotoFolder, options: PlaceOptions) -> list[Pose]:
    if options.places == "utm":
        return utm_poses(photos.paths, key)
    paths = [photos.folder.resolve() / name for name in photos.names]
    for folder in (photos.folder, photos.folder.absolute().parent):
        if (folder / TABLE).is_file():
            return table_poses(paths, photos.folder, folder / TABLE, key)
    raise UserError(
        f"places=csv: neither {key}={photos.folder} nor the folder around it has a table {TABLE}",
        "Write one with the columns file,x,y or file,x,y,heading; or choose another places=: utm, name, order.",
    )


def _name_frames(reference: Sequence[str], queries: Sequence[str]) -> Int64[ndarray, "n"]:
    """A number for each name without its suffix, in natural order."""
    stems = [Path(name).with_suffix("").as_posix() for name in (*reference, *queries)]
    number = {stem: i for i, stem in enumerate(sorted(set(stems), key=natural_key))}
    return np.array([number[stem] for stem in stems], np.int64)


def _ride_frames(names: Sequence[str]) -> Int64[ndarray, "n"]:
    """Numbers along the order of the names; those of two folders are far apart."""
    folders = [Path(name).parent for name in names]
    number = {folder: i for i, folder in enumerate(dict.fromkeys(folders))}
    return np.array([i + BETWEEN_FOLDERS * number[folder] for i, folder in enumerate(folders)], np.int64)
