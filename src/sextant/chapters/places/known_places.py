"""Which map images show the same place and, where the ground truth is known, which show the place of a query."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int64
from numpy import ndarray
from scipy.spatial import cKDTree

from sextant.chapters.places.data import ImageRows, PlaceImages, PlaceTolerance
from sextant.chapters.places.data.gps_poses import gps_poses
from sextant.chapters.places.data.pose_files import Pose, table_poses, utm_poses
from sextant.chapters.places.data.tolerance import Unit
from sextant.chapters.places.describing import DescribedPhotos
from sextant.chapters.places.photo_folder import KnownBy, PhotoFolder
from sextant.data.image_files import natural_key
from sextant.errors import ArgumentError
from sextant.evaluation.positives import Positives

TABLE = "poses.csv"
#: frames between two folders of one map, more than any tolerance
BETWEEN_FOLDERS = 10**9


@dataclass(frozen=True)
class KnownPlaces:
    """Which images show the same place.

    Attributes:
        tolerance: what counts as one place.
        same_place: for each map image, the map images of its place, with or without itself.
        positives: for each query, the map images of its place; None where the ground truth is unknown.
        remarks: notes for the user.
    """

    tolerance: PlaceTolerance
    same_place: Positives
    positives: Positives | None
    remarks: tuple[str, ...] = ()


def same_place(described: DescribedPhotos, tolerance: float) -> Positives:
    """For each photo of a map, the photos of its place, including itself.

    Args:
        described: the map.
        tolerance: largest distance within one place: in metres between positions, or, for a map without positions, in
            photos of one folder in the order of the map.
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
    places: KnownBy,
    tolerances: Mapping[Unit, PlaceTolerance],
    distance: float | None = None,
) -> KnownPlaces:
    """Which of the described photos show the same place.

    Args:
        reference: the map.
        queries: photos to be looked up.
        places: source of the ground truth.
        tolerances: what counts as one place, by unit.
        distance: largest distance within one place, in place of the tolerance's own: in metres if places are known by
            poses, otherwise in files.

    Raises:
        UserError: the photos lack what ``places`` requires: a table, poses in their names, equal numbers.
    """
    unit: Unit = "m" if places in ("csv", "utm", "gps") else "frames"
    tolerance = tolerances[unit]
    chosen = 0.0 if distance is None and places == "none" else distance
    if chosen is not None:
        tolerance = replace(
            tolerance, positive=chosen, negative=max(tolerance.negative, math.nextafter(chosen, math.inf))
        )
    if places == "none":
        along_the_ride = replace(reference, positions=None)
        return KnownPlaces(tolerance, same_place(along_the_ride, tolerance.positive), None)
    remarks: list[str] = []
    images = _placed(reference.photos, queries.photos, places, remarks)
    if images.heading_deg is None and tolerance.heading_deg is not None:
        tolerance = replace(tolerance, heading_deg=None)
        remarks.append("headings are unknown and were not compared")
    of_map, of_queries = reference.rows, len(reference.photos) + queries.rows
    same = Positives.from_sparse(images.positives(of_map, of_map, tolerance))
    positives = Positives.from_sparse(images.positives(of_queries, of_map, tolerance))
    if images.position_m is not None and not positives.matchable.any():
        nearest = cKDTree(images.position_m[of_map]).query(images.position_m[of_queries])[0].min()
        remarks.append(f"no query is at the place of a map image: the nearest pair is {nearest:,.0f} m apart")
    return KnownPlaces(tolerance, same, positives, tuple(remarks))


def check_truth(reference: PhotoFolder, queries: PhotoFolder, places: KnownBy) -> None:
    """Raise a ``UserError`` if the photos lack what ``places`` requires, before any of them is described."""
    if places != "none":
        _placed(reference, queries, places, [])


def _placed(reference: PhotoFolder, queries: PhotoFolder, places: KnownBy, remarks: list[str]) -> PlaceImages:
    """The places of all photos, the map's first; without pixels. Doubtful ones are noted in ``remarks``."""
    both = (reference, queries)
    frames = np.concatenate([np.arange(len(photos)) for photos in both])
    positions, headings = None, None
    if places == "name":
        frames = _name_frames(reference.names, queries.names)
    elif places == "order":
        if len(reference) != len(queries):
            raise ArgumentError(
                f"places=order pairs the i-th photos of both folders, but {reference.folder} has {len(reference):,} "
                f"and {queries.folder} has {len(queries):,}",
                "Remove unpaired photos, or use equal names (places=name) or poses (places=csv or places=utm).",
            )
    else:
        if places == "gps":
            poses = gps_poses([path for photos in both for path in photos.paths], "places=gps", remarks)
        else:
            poses = [pose for photos in both for pose in _poses(photos, places)]
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


def _poses(photos: PhotoFolder, places: KnownBy) -> list[Pose]:
    if places == "utm":
        return utm_poses(photos.paths, str(photos.folder))
    paths = [photos.folder.resolve() / name for name in photos.names]
    for folder in (photos.folder, photos.folder.absolute().parent):
        if (folder / TABLE).is_file():
            return table_poses(paths, photos.folder, folder / TABLE, str(photos.folder))
    raise ArgumentError(
        f"places=csv: neither {photos.folder} nor its parent folder has a table {TABLE}",
        "Write one with the columns file,x,y or file,x,y,heading; or choose places=utm, places=name or places=order.",
    )


def _name_frames(reference: Sequence[str], queries: Sequence[str]) -> Int64[ndarray, "n"]:
    """A number for each name without its suffix, in natural order."""
    stems = [Path(name).with_suffix("").as_posix() for name in (*reference, *queries)]
    number = {stem: i for i, stem in enumerate(sorted(set(stems), key=natural_key))}
    return np.array([number[stem] for stem in stems], np.int64)


def _ride_frames(names: Sequence[str]) -> Int64[ndarray, "n"]:
    """Numbers in the order of the names; those of two folders are far apart."""
    folders = [Path(name).parent for name in names]
    number = {folder: i for i, folder in enumerate(dict.fromkeys(folders))}
    return np.array([i + BETWEEN_FOLDERS * number[folder] for i, folder in enumerate(folders)], np.int64)
