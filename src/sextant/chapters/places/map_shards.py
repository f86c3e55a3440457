"""Describing the photos of a map in parts, each by a separate process on any host, and merging the parts.

A part is a map by itself, of consecutive whole batches. Each photo is therefore described in the same batch as by a
single process, and the merged map is byte-identical.
"""

from pathlib import Path

from sextant.applications.failures import raise_failed
from sextant.chapters.places.described_map import DescribedMap, silent
from sextant.chapters.places.describing import BATCH, joined
from sextant.chapters.places.photo_folder import HEADER, PhotoFolder
from sextant.chapters.places.saved_map import load_map
from sextant.errors import ArgumentError, UserError
from sextant.reporter import Advance
from sextant.tables import counted


def shard_folder(folder: Path, shard: int, shards: int) -> Path:
    """The folder of a part, below the folder of the map."""
    return folder / "shards" / f"{shard}_of_{shards}"


def photos_of(photos: PhotoFolder, shard: int, shards: int) -> PhotoFolder:
    """The photos of one part.

    Raises:
        ArgumentError: there is no such part, or it would have no photos.
    """
    if not 0 <= shard < shards:
        raise ArgumentError(f"shard={shard}: there are shards 0 to {shards - 1}", "shards=3 has shard=0, 1 and 2")
    batches = -(-len(photos) // BATCH)
    if shards > batches:
        raise ArgumentError(
            f"shards={shards}: {counted(len(photos), 'photo')} in {batches} batches of {BATCH}",
            f"At most shards={batches}",
        )
    first, last = (number * batches // shards * BATCH for number in (shard, shard + 1))
    return PhotoFolder(photos.folder, photos.names[first:last])


def describe_shard(
    places: DescribedMap, photos: PhotoFolder, folder: Path, shard: int | None, shards: int, progress: Advance = silent
) -> None:
    """Describe and save one part, or all photos as one map; existing files are replaced.

    Args:
        places: an empty map.
        photos: photos of all parts together.
        folder: folder of the map.
        shard: number of the part, from 0; None for all.
        shards: number of parts.
        progress: called with the number of photos done and the total.

    Raises:
        ArgumentError: there is no such part.
        FailedPhotosError: none of the photos could be described.
    """
    part = photos if shard is None else photos_of(photos, shard, shards)
    failed = places.add(part, errors="return", progress=progress)
    if not len(places):
        raise_failed(failed, len(part), "described", "raise")
    places.save(folder if shard is None else shard_folder(folder, shard, shards), descriptor=shard is None)


def merge_shards(places: DescribedMap, photos: PhotoFolder, folder: Path, shards: int) -> None:
    """Merge all parts into one map and save it; each part is checked against its hash on the way.

    Args:
        places: an empty map, whose network described the parts.
        photos: photos of all parts together.
        folder: folder of the map.
        shards: number of parts.

    Raises:
        UserError: a part is missing, damaged, of another network or of other photos. The message names it, and nothing
            is written; only that part has to be described again.
    """
    numbers = range(shards)
    again = f"Describe what is missing: shards={shards} shard="
    missing = [n for n in numbers if not (shard_folder(folder, n, shards) / HEADER).is_file()]
    if missing:
        raise UserError(f"not described yet: shard {', '.join(map(str, missing))} of {shards}", f"{again}{missing[0]}")
    parts = []
    for number in numbers:
        described, facts = load_map(shard_folder(folder, number, shards))
        if facts.model != places.model or described.photos.names != photos_of(photos, number, shards).names:
            what = "of another network" if facts.model != places.model else "of other photos"
            raise UserError(f"shard {number} of {shards} is {what} than the map", f"{again}{number}")
        parts.append(described)
    places.hold(joined(parts))
    places.save(folder)
