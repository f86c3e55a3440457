"""Descriptors of a folder of photos, kept so that they can be searched again without the photos.

A folder holds a :class:`~sextant.retrieval.FlatIndex` (``descriptors.npy``, ``index.json``), and ``map.json``, which
tells of which network and photos it is. The latter is written last, and has the hash of ``index.json`` and of itself.
"""

from pathlib import Path
from typing import Any

from sextant.applications.places.describing import DescribedPhotos
from sextant.applications.places.photo_folder import HEADER, PhotoFolder
from sextant.atomic_files import read_json, seal_holds, write_sealed_json
from sextant.data.places.decoded_images import DECODER
from sextant.data.source import file_sha256
from sextant.errors import UserError
from sextant.retrieval import flat_index
from sextant.retrieval.flat_index import FlatIndex

FORMAT, VERSION = "sextant.place_map", 1


def save_map(described: DescribedPhotos, model: str, folder: Path) -> None:
    """Write descriptors with the names of their photos; what was there is replaced.

    Raises:
        OSError: the disk is full, or the folder cannot be written to.
    """
    described.index.save(folder)
    header = {
        "format": FORMAT,
        "version": VERSION,
        "model": model,
        "decoder": DECODER,
        "folder": str(described.photos.folder.absolute()),
        "photos": list(described.photos.names),
        "failed": dict(described.failed),
        "stretched": list(described.stretched),
        "index_sha256": file_sha256(folder / flat_index.HEADER),
    }
    write_sealed_json(folder / HEADER, header)


def load_map(folder: Path, model: str) -> DescribedPhotos:
    """Open saved descriptors; they are mapped into memory.

    Args:
        folder: that they were saved to.
        model: of the network that describes the queries.

    Raises:
        UserError: they are of another network, of a version of Sextant that decodes images otherwise, or damaged.
    """
    header = read_json(folder / HEADER)
    if not isinstance(header, dict) or header.get("format") != FORMAT or header.get("version") != VERSION:
        raise _unusable(folder, f"{HEADER} is not the header of descriptors of version {VERSION}")
    if not seal_holds(header):
        raise _unusable(folder, f"{HEADER} was altered: it does not match its own hash")
    if not _well_formed(header):
        raise _unusable(folder, f"{HEADER} lacks keys, or they have values of the wrong kind")
    if header["model"] != model:
        raise _unusable(
            folder,
            f"they are of another network ({str(header['model'])[:12]}) than run= is ({model[:12]}), "
            "and descriptors of two networks cannot be compared",
        )
    if header["decoder"] != DECODER:
        raise _unusable(folder, "they are of a version of Sextant that decodes photos otherwise")
    index = FlatIndex.load(folder)
    photos = PhotoFolder(Path(header["folder"]), tuple(header["photos"]))
    found = DescribedPhotos(photos, index, header["failed"], tuple(header["stretched"]))
    if file_sha256(folder / flat_index.HEADER) != header["index_sha256"] or index.names != found.names:
        raise _unusable(folder, f"{flat_index.HEADER} is not the one that {HEADER} was written for")
    return found


def _well_formed(header: dict[str, Any]) -> bool:
    texts = all(isinstance(header.get(key), str) for key in ("model", "folder", "index_sha256"))
    lists = all(
        isinstance(header.get(key), list) and all(isinstance(name, str) for name in header[key])
        for key in ("photos", "stretched")
    )
    failed = header.get("failed")
    return texts and lists and isinstance(failed, dict) and all(isinstance(why, str) for why in failed.values())


def _unusable(folder: Path, why: str) -> UserError:
    return UserError(
        f"map={folder}: these descriptors cannot be used: {why}",
        "Describe the map's photos anew: map=<folder of photos> descriptors=true",
    )
