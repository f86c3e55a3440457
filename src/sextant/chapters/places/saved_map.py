"""Saved descriptors of photos, which can be searched again without the photos.

A folder holds a :class:`~sextant.retrieval.FlatIndex` (``descriptors.npy``, ``index.json``) and ``map.json``, which
states the network and the photos. The latter is written last, and holds the hash of ``index.json`` and of itself.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.array_folder import FolderFormat, plain_values
from sextant.atomic_files import hash_file
from sextant.chapters.places.data.decoded_images import DECODER, ImageSize
from sextant.chapters.places.data.tolerance import PlaceTolerance, Unit
from sextant.chapters.places.describing import DescribedPhotos
from sextant.chapters.places.match_confidence import UNSEEN, MatchConfidence
from sextant.chapters.places.photo_folder import HEADER, PhotoFolder
from sextant.errors import UserError
from sextant.kit.published_places import CARD
from sextant.retrieval import flat_index
from sextant.retrieval.flat_index import FlatIndex
from sextant.runs.resolve import FoundRun, resolve_run

#: the test fits one temperature and reports it under the protocol of every condition
TEMPERATURE = "test/place_temperature_"
#: key of a network's spec: ``temperature``, ``slope`` and ``offset`` of its confidences, if these were fitted to
#: scenes not used in training
FITTED = "fitted_unseen"


class Temperature(NamedTuple):
    """The temperature of the posterior over a map, or None and the reason why there is none."""

    value: float | None
    lacking: str = ""


def run_temperature(found: FoundRun) -> Temperature:
    """The temperature that the run's test fitted on its validation split, for the weights in this checkpoint."""
    if found.directory is None:
        return Temperature(None, "the checkpoint lies outside its run's folder, where the temperature is stored")
    results = found.directory.results()
    if results is None:
        return Temperature(None, "the run is not finished, and the temperature is fitted in its test")
    tested = resolve_run(str(found.directory.path), found.directory.path).checkpoint
    if tested != found.checkpoint:
        return Temperature(None, f"the run's temperature is that of {tested.name}, not of {found.checkpoint.name}")
    fitted = [value for name, value in results.get("metrics", {}).items() if name.startswith(TEMPERATURE)]
    if not fitted or not isinstance(fitted[0], float) or not fitted[0] > 0:
        return Temperature(None, "the run's test fitted no temperature")
    return Temperature(fitted[0])


def fitted_confidence(facts: Mapping[str, Any]) -> MatchConfidence | None:
    """The confidence of matches by their margin: fitted for this network, or the default of networks.

    None for descriptors other than networks of Sextant.

    Args:
        facts: facts of the descriptor, as in :class:`~sextant.chapters.places.saved_descriptor.SavedDescriptor`.
    """
    if facts["kind"] != "network" or CARD in facts:
        return None
    fitted = facts["spec"].get(FITTED)
    return UNSEEN if fitted is None else MatchConfidence(fitted["slope"], fitted["offset"])


def run_facts(given: str, found: FoundRun, model: str, trained: Mapping[str, Any]) -> dict[str, Any]:
    """Which run, which weights, and which training data."""
    facts = {"run": given, "checkpoint": str(found.checkpoint), "checkpoint_sha256": model}
    if CARD in trained:
        return facts | {CARD: trained[CARD]}
    return facts | {key: trained.get(key) for key in ("digest", "seed", "code")} | {"data": trained.get("data")}


#: default tolerances, for maps without a run
TOLERANCES: dict[Unit, PlaceTolerance] = {"m": PlaceTolerance("m", 5, 25), "frames": PlaceTolerance("frames", 0, 1)}
ELSEWHERE = Temperature(None, "the network is not of Sextant, and no temperature was fitted to it")
NO_TEMPERATURE = Temperature(None, "the map was saved without a temperature")
KIND = FolderFormat("a map of photos", "sextant.place_map", 1, HEADER)


@dataclass(frozen=True)
class MapFacts:
    """What the header of a map states besides its photos.

    Attributes:
        model: identifies the network among others.
        descriptor: whether the descriptor is saved beside the map.
        temperature: temperature of the posterior over the map.
        tolerance: largest distance within one place, if it was set.
        tolerances: what counts as one place, by unit.
        size: size of the images that the network takes; None for the network's own.
    """

    model: str
    descriptor: bool = False
    temperature: Temperature = NO_TEMPERATURE
    tolerance: float | None = None
    tolerances: Mapping[Unit, PlaceTolerance] = field(default_factory=lambda: TOLERANCES)
    size: ImageSize | None = None

    def header(self) -> dict[str, Any]:
        """These facts as the header holds them.

        Raises:
            ArgumentError: JSON cannot hold one of them; the message names it.
        """
        return plain_values({**asdict(self), "temperature": self.temperature._asdict()})


def save_map(described: DescribedPhotos, facts: Mapping[str, Any], folder: Path) -> None:
    """Write descriptors with the names of their photos; existing files are replaced.

    Args:
        described: the photos.
        facts: what :meth:`MapFacts.header` gives.
        folder: folder to write into.

    Raises:
        OSError: the disk is full, or the folder cannot be written to.
    """
    described.index.save(folder)
    photos = {
        "decoder": DECODER,
        "folder": str(described.photos.folder.absolute()),
        "photos": list(described.photos.names),
        "failed": dict(described.failed),
        "stretched": list(described.stretched),
        "positions": None if described.positions is None else described.positions.tolist(),  # nan becomes null
        "index_sha256": hash_file(folder / flat_index.HEADER),
    }
    KIND.write_header(folder, {**facts, **photos})


def read_facts(folder: Path) -> MapFacts:
    """Read what the header of a map states besides its photos.

    Raises:
        UserError: there is no map, or its header is damaged.
    """
    return _facts(_header(folder), folder)


def load_map(folder: Path) -> tuple[DescribedPhotos, MapFacts]:
    """Open saved descriptors, memory-mapped.

    Raises:
        UserError: they are damaged, or of a version of Sextant that decodes images differently.
    """
    header = _header(folder)
    if header["decoder"] != DECODER:
        raise UserError(
            f"the map in {folder} is from a version of Sextant that decodes photos differently", "Add its photos again."
        )
    index = FlatIndex.load(folder)
    photos = PhotoFolder(Path(header["folder"]), tuple(header["photos"]))
    try:
        positions = _positions(header.get("positions"), len(index))
    except (ValueError, TypeError):
        raise KIND.damaged(folder, f"{HEADER} does not give a position for each photo") from None
    found = DescribedPhotos(photos, index, header["failed"], tuple(header["stretched"]), positions)
    if hash_file(folder / flat_index.HEADER) != header["index_sha256"] or index.names != found.names:
        raise KIND.damaged(folder, f"{flat_index.HEADER} is not the one that {HEADER} was written for")
    return found, _facts(header, folder)


def _header(folder: Path) -> dict[str, Any]:
    header = KIND.read_header(folder)
    if not _well_formed(header):
        raise KIND.damaged(folder, f"{HEADER} lacks keys, or they have values of the wrong kind")
    return header


def _facts(header: Mapping[str, Any], folder: Path) -> MapFacts:
    if "size" not in header:  # written before these were stored
        return MapFacts(header["model"])
    try:
        value, lacking, tolerance = *(header["temperature"][key] for key in ("value", "lacking")), header["tolerance"]
        return MapFacts(
            header["model"],
            bool(header["descriptor"]),
            Temperature(None if value is None else float(value), str(lacking)),
            None if tolerance is None else float(tolerance),
            {unit: PlaceTolerance(**header["tolerances"][unit]) for unit in TOLERANCES},
            ImageSize(**{key: int(side) for key, side in header["size"].items()}),
        )
    except (AttributeError, KeyError, TypeError, ValueError, UserError) as error:
        raise KIND.damaged(folder, f"{HEADER} does not state how photos are looked up: {error!r}") from error


def _positions(rows: Any, count: int) -> Float64[ndarray, "n 2"] | None:
    """Positions from the header; None in older headers, which have none."""
    if rows is None:
        return None
    positions = np.array(rows, np.float64)  # null is nan
    if positions.shape != (count, 2):
        raise ValueError(f"{positions.shape} for {count} photos")
    return positions


def _well_formed(header: dict[str, Any]) -> bool:
    texts = all(isinstance(header.get(key), str) for key in ("model", "folder", "index_sha256"))
    lists = all(
        isinstance(header.get(key), list) and all(isinstance(name, str) for name in header[key])
        for key in ("photos", "stretched")
    )
    failed = header.get("failed")
    return texts and lists and isinstance(failed, dict) and all(isinstance(why, str) for why in failed.values())
