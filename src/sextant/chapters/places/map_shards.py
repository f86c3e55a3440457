"""Describing the photos of a map in parts, each by a separate process on any host, and merging the parts.

A part is a map by itself, of consecutive whole batches. Each photo is therefore described in the same batch as by a
single process, and the merged map is byte-identical.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from sextant.applications.failures import raise_failed
from sextant.array_folder import FolderFormat
from sextant.chapters.places.described_map import DescribedMap, failed_photo, silent
from sextant.chapters.places.describing import BATCH, joined
from sextant.chapters.places.photo_folder import HEADER, PhotoFolder
from sextant.chapters.places.saved_map import load_map
from sextant.errors import ArgumentError, UserError
from sextant.reporter import Advance
from sextant.tables import counted

#: a part none of whose photos could be described, which is no map
UNUSABLE = FolderFormat("a part without usable photos", "sextant.place_map_unusable", 1, "unusable.json")


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
) -> Mapping[str, str]:
    """Describe and save one part, or all photos as one map; existing files are replaced.

    Args:
        places: an empty map.
        photos: photos of all parts together.
        folder: folder of the map.
        shard: number of the part, from 0; None for all.
        shards: number of parts.
        progress: called with the number of photos done and the total.

    Returns:
        Why photos could not be described, by name. A part may have no others: it then holds only these names.

    Raises:
        ArgumentError: there is no such part.
        FailedPhotosError: none of the photos of all parts together could be described.
    """
    part = photos if shard is None else photos_of(photos, shard, shards)
    failed = places.add(part, errors="return", progress=progress, among=photos)
    if shard is None:
        if not len(places):
            raise_failed(failed, len(part), "described", "raise")
        places.save(folder)
        return places.described.failed
    own = shard_folder(folder, shard, shards)
    for header in (HEADER, UNUSABLE.header):
        (own / header).unlink(missing_ok=True)
    if len(places):
        places.save(own, descriptor=False)
        return places.described.failed
    reasons = (each.error.problem.removeprefix(f"{each.name}: ") for each in failed)
    named = dict(zip(part.names, reasons, strict=True))
    UNUSABLE.write_header(own, {"model": places.model, "failed": named})
    return named


def merge_shards(places: DescribedMap, photos: PhotoFolder, folder: Path, shards: int) -> Mapping[str, str]:
    """Merge all parts into one map and save it; each part is checked against its hash on the way.

    Args:
        places: an empty map, whose network described the parts.
        photos: photos of all parts together.
        folder: folder of the map.
        shards: number of parts.

    Returns:
        Why photos could not be described, by name.

    Raises:
        FailedPhotosError: none of the photos of all parts together could be described.
        UserError: a part is missing, damaged, of another network or of other photos. The message names it, and nothing
            is written; only that part has to be described again.
    """
    folders = [shard_folder(folder, number, shards) for number in range(shards)]
    again = f"Describe what is missing: shards={shards} shard="
    missing = [n for n, own in enumerate(folders) if not any((own / h).is_file() for h in (HEADER, UNUSABLE.header))]
    if missing:
        raise UserError(f"not described yet: shard {', '.join(map(str, missing))} of {shards}", f"{again}{missing[0]}")
    parts, failed = [], dict[str, str]()
    for number, own in enumerate(folders):
        if (own / HEADER).is_file():
            described, facts = load_map(own)
            parts.append(described)
            model, names, reasons = facts.model, described.photos.names, described.failed
        else:
            header = UNUSABLE.read_header(own)
            model, names, reasons = header["model"], tuple(header["failed"]), header["failed"]
        if model != places.model or names != photos_of(photos, number, shards).names:
            what = "of another network" if model != places.model else "of other photos"
            raise UserError(f"shard {number} of {shards} is {what} than the map", f"{again}{number}")
        failed |= reasons
    if not parts:
        raise_failed([failed_photo(*each) for each in failed.items()], len(photos), "described", "raise")
    whole = joined(parts)
    places.hold(replace(whole, photos=replace(whole.photos, names=photos.names), failed=failed))
    places.save(folder)
    return failed
