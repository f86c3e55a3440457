"""Sibling folders of images: traverses of the same places, or classes."""

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sextant.chapters.places.data.pose_files import parse_utm_name
from sextant.chapters.places.photo_folder import KnownBy
from sextant.tools.inspection.seen import Seen

#: common names of folders of a traverse; the first are those of maps
MAPS = ("map", "reference", "ref", "database", "db", "gallery")
RIDES = (*MAPS, "query", "queries", "run", "day", "night", "summer", "winter", "spring", "autumn", "fall")
#: share of names that two traverses have in common if equal names mean equal places
SHARED = 0.9
#: more folders than this are not traverses
MOST = 12


@dataclass(frozen=True)
class ImageFolders:
    """Sibling folders, relative to the one that is inspected.

    Attributes:
        base: the folder around them.
        traverses: traverses, the map first; empty if the folders are not traverses.
        places: source of the ground truth, i.e. which of their images show the same place.
        classes: number of images by class; empty if one has a file of poses, or if the folders are traverses, unless
            equal names alone indicate this: images of classes are often numbered as well.
    """

    base: Path
    traverses: tuple[Path, ...]
    places: KnownBy
    classes: dict[str, int]


def image_folders(seen: Seen) -> ImageFolders:
    """Whether sibling folders are traverses or classes, by their names and those of their images."""
    files = list(seen.headers)
    base = Path(os.path.commonpath([file.parent for file in files] or [Path()]))
    by_child: dict[Path, list[Path]] = {}
    for file in files:
        if len(file.relative_to(base).parts) > 1:
            by_child.setdefault(base / file.relative_to(base).parts[0], []).append(file)
    loose = sum(map(len, by_child.values())) < len(files)
    if len(by_child) < 2 or loose or len(seen.panoramas) == len(files):
        return ImageFolders(base, (), "none", {})
    splits = {folder.name for folder in by_child}
    if splits == {"train", "test"}:  # folders of classes
        inner = {name: _children(by_child[base / name], base / name) for name in splits}
        if len(inner["train"]) > 1 and inner["train"].keys() == inner["test"].keys():
            return ImageFolders(base, (), "none", inner["train"])
    driven = {poses.images for poses in seen.poses if poses.images and poses.format != "gps"}
    classes = {folder.name: len(inside) for folder, inside in by_child.items()}
    if any(images.is_relative_to(folder) for images in driven for folder in by_child):
        classes = {}
    places = _places(seen, by_child)
    rides = [folder for folder in by_child if folder.name.lower().split("_")[0].split("-")[0] in RIDES]
    known = places not in ("none", "gps")  # photos of classes may have GPS positions too
    if len(by_child) <= MOST and (known or len(rides) == len(by_child)):
        ordered = sorted(by_child, key=lambda folder: not folder.name.lower().startswith(MAPS))
        either = places == "name" and len(rides) < len(by_child)
        return ImageFolders(base, tuple(ordered), places, classes if either else {})
    return ImageFolders(base, (), "none", classes)


def _children(files: Sequence[Path], base: Path) -> Counter[str]:
    """Number of ``files`` by the folder within ``base``."""
    parts = [file.relative_to(base).parts for file in files]
    return Counter(each[0] for each in parts if len(each) > 1)


def _places(seen: Seen, by_child: dict[Path, list[Path]]) -> KnownBy:
    """How images of two folders that show the same place are known; ``none`` if they are not known for all."""
    tables = {poses.file.parent for poses in seen.poses if poses.format == "csv" and poses.posed and not poses.unposed}
    if tables.issuperset(by_child):
        return "csv"
    if all(parse_utm_name(file.name) for files in by_child.values() for file in files):
        return "utm"
    if all(seen.headers[file].gps.position for files in by_child.values() for file in files):
        return "gps"
    names = [{file.relative_to(folder).with_suffix("") for file in files} for folder, files in by_child.items()]
    shared, smallest = set.intersection(*names), min(map(len, names))
    return "name" if len(shared) >= max(2, SHARED * smallest) else "none"
