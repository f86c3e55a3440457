"""A map of photos as descriptors, with which other descriptors are matched as arrays."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Any, Self

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from sextant.applications.arguments import check_kind, check_whole, make_folder
from sextant.applications.failures import Errors, FailedPhoto, check_errors, raise_failed
from sextant.applications.pixels import detached
from sextant.baselines import WhitenedPCA
from sextant.chapters.places.data.decoded_images import ImageSize
from sextant.chapters.places.data.tolerance import PlaceTolerance, Unit
from sextant.chapters.places.describing import Described, DescribedPhotos, describe, joined, without_failed
from sextant.chapters.places.given_descriptors import given_rows
from sextant.chapters.places.known_places import same_place
from sextant.chapters.places.matching import Matches, match
from sextant.chapters.places.photo_folder import PhotoFolder, photo_folder
from sextant.chapters.places.saved_descriptor import Describes, SavedDescriptor, kept_baseline, named_baseline
from sextant.chapters.places.saved_map import TOLERANCES, MapFacts, Temperature, load_map, save_map
from sextant.errors import ArgumentError, UserError, shown
from sextant.evaluation.positives import Positives
from sextant.reporter import Advance
from sextant.retrieval import FlatIndex
from sextant.retrieval.without_mean import Centring, centred
from sextant.tables import counted

DESCRIPTOR = "descriptor"
NO_RUN = "the descriptor is not that of a run, whose test would fit a temperature"


def silent(done: int, total: int) -> None:
    """Report no progress."""


class DescribedMap:
    """Photos that are added, described and saved; the part of :class:`~sextant.PlaceMap` that decodes no queries.

    Args:
        descriptor, size, temperature, tolerances: as for :class:`~sextant.PlaceMap`.
    """

    def __init__(
        self,
        descriptor: Describes | SavedDescriptor | str,
        size: ImageSize | None = None,
        *,
        temperature: Temperature | float | None = None,
        tolerances: Mapping[Unit, PlaceTolerance] = TOLERANCES,
    ):
        if isinstance(descriptor, str):
            descriptor = named_baseline(descriptor)
        if isinstance(descriptor, WhitenedPCA) and not hasattr(descriptor, "pca_"):
            raise ArgumentError(
                "descriptor: WhitenedPCA has not been fitted to images", "Fit it: WhitenedPCA().fit(images)"
            )
        self.descriptor = descriptor if isinstance(descriptor, SavedDescriptor) else kept_baseline(descriptor)
        if self.descriptor.describer is None:
            raise ArgumentError("descriptor: it cannot describe images", "Give one of sextant.baselines, or a network.")
        self._describer = self.descriptor.describer
        check_kind("size", size, ImageSize, "For example size=ImageSize(64, 96)")
        self.size = size or _size_of(self._describer)
        self.model = self.descriptor.model
        told = temperature if isinstance(temperature, Temperature) else Temperature(temperature, NO_RUN)
        number = isinstance(told.value, Real) and not isinstance(told.value, bool)
        if told.value is not None and not (number and 0 < told.value < math.inf):
            raise ArgumentError(
                f"temperature={shown(told.value)} must be a finite number above 0", "For example temperature=0.05"
            )
        self.temperature, self.tolerances = told, dict(tolerances)
        self._tolerance: float | None = None
        self._parts: list[DescribedPhotos] = []
        self._files: set[Path] = set()
        self._same: tuple[DescribedPhotos, float, Positives] | None = None

    def __len__(self) -> int:
        """The number of photos with a descriptor."""
        return sum(len(part.index) for part in self._parts)

    @property
    def tolerance(self) -> float | None:
        """Largest distance within one place, over whose photos the confidence is summed.

        In metres where photos were added with positions, otherwise in photos along a ride. None, the default, stands
        for the run's tolerance in metres, or for 0 photos.

        Raises:
            ArgumentError: it is set to anything but a number of at least 0.
        """
        return self._tolerance

    @tolerance.setter
    def tolerance(self, value: float | None) -> None:
        number = isinstance(value, Real) and not isinstance(value, bool)
        if value is not None and not (number and 0 <= value < math.inf):
            raise ArgumentError(
                f"tolerance={shown(value)} must be a finite number, at least 0, or None", "For example tolerance=25"
            )
        self._tolerance = value

    @property
    def described(self) -> DescribedPhotos:
        """All photos that were added, with their descriptors.

        Raises:
            UserError: there are none.
        """
        if not self._parts:
            raise UserError("the map is empty", "Add photos to it: add(photos)")
        if len(self._parts) > 1:
            self._parts = [joined(self._parts)]
        return self._parts[0]

    def add(
        self,
        photos: PhotoFolder | Path | str | Iterable[Path | str],
        positions: Float[ndarray, "n 2"] | Sequence[Sequence[float]] | None = None,
        *,
        descriptors: Float[ndarray, "n d"] | Path | str | None = None,
        errors: Errors = "raise",
        progress: Advance = silent,
        among: PhotoFolder | None = None,
    ) -> list[FailedPhoto]:
        """Add photos to the map.

        Args:
            photos: a folder, whose photos are added in the natural order of their names, a file, or files.
            positions: x and y of each photo in metres, in the same order; nan where unknown.
            descriptors: of each photo in the same order, an array or a file of ``numpy.save``, as this map's descriptor
                gives them; None: the photos are described here.
            errors: ``raise`` adds what can be described, then raises if some photos could not; ``return`` returns
                these.
            progress: called with the number of photos done and the total.
            among: all photos of the map, if these are a part that is described by itself.

        Returns:
            The photos that could not be described, of which the map keeps only the names.

        Raises:
            FailedPhotosError: photos could not be described; the message names them, and the others are in the map.
            ArgumentError: there are no photos, they are not files, some are in the map already, positions are not x and
                y of each photo, or the map's descriptor does not return one row of numbers for each.
            UserError: the given descriptors are not those of as many photos, or of other length than the map's.
        """
        check_errors(errors)
        given = photo_folder(photos)
        where = None if positions is None else _positions(positions, len(given))
        files = [path.absolute() for path in given.paths]
        if twice := [path for path, count in Counter([*files, *self._files.intersection(files)]).items() if count > 1]:
            raise ArgumentError(f"photos: {twice[0]} is in the map already", "Add each photo once.")
        if descriptors is None:
            found = describe(self._describer, self.size, given.paths, progress, None if among is None else among.paths)
        else:
            found = Described(self.given(descriptors, len(given)), {}, ())
        failed = [failed_photo(str(given.paths[i]), why) for i, why in sorted(found.failed.items())]
        if len(found.rows):
            self._parts = [without_failed(part, set(files)) for part in self._parts] + [_part(given, found, where)]
            self._files |= {path.absolute() for path in self._parts[-1].paths}
        raise_failed(failed, len(given), "described", errors, "go on: the others are in the map.")
        return failed

    def given(self, descriptors: Float[ndarray, "n d"] | Path | str, count: int | None = None) -> ndarray:
        """Descriptors from elsewhere as rows that this map can be compared with.

        Raises:
            UserError: they are not finite rows of floats, one per photo, or of other length than the map's.
        """
        rows = given_rows(descriptors, count)
        own = getattr(self._describer, "dimension", None)
        known = self._parts[0].index.dimension if self._parts else own
        if known is not None and rows.shape[1] != known:
            raise UserError(
                f"descriptors: {rows.shape[1]} numbers per photo, but those of the map have {known}",
                "Map and queries must be described by the same network.",
            )
        return rows

    def save(self, folder: Path | str, *, descriptor: bool = True) -> None:
        """Write the map into a folder, without pickles; a map that was there is replaced.

        Args:
            folder: folder to write into; created if needed.
            descriptor: save the descriptor too, so that the folder can be opened by itself.

        Raises:
            UserError: the map is empty, or a setting cannot be saved; then a map that was there is kept.
            OSError: the disk is full, or the folder cannot be written to.
        """
        folder = make_folder("folder", folder)
        kept = descriptor and self.descriptor.facts["kind"] != "none"
        described = self.described
        facts = MapFacts(self.model, kept, self.temperature, self.tolerance, self.tolerances, self.size).header()
        if kept:
            self.descriptor.save(folder / DESCRIPTOR)
        save_map(described, facts, folder)

    def take(self, folder: Path) -> Self:
        """Load the photos of a saved map into this one, replacing its own.

        Raises:
            UserError: there is no map, it is damaged, or its photos were described by another network.
        """
        described, facts = load_map(folder)
        if facts.model != self.model:
            raise UserError(
                f"the map in {folder} is of another network ({facts.model[:12]}) than the one given "
                f"({self.model[:12]}); descriptors of different networks cannot be compared",
                "Name the run that the map was made with, or add its photos again.",
            )
        self.hold(described)
        return self

    def hold(self, described: DescribedPhotos) -> None:
        """Hold photos that this map's descriptor has described, replacing its own."""
        self._parts, self._files = [described], {path.absolute() for path in described.paths}

    def match(
        self,
        queries: FlatIndex,
        k: int,
        *,
        centring: Centring = "none",
        sequence: int | None = None,
        same: Positives | None = None,
        progress: Advance = silent,
    ) -> Matches:
        """Look up descriptors given as arrays.

        Args:
            queries: descriptors of the queries, in the order of their ride if they are matched by sequences.
            k: number of matches, at least 1; a smaller map returns all its photos.
            centring: which mean descriptor is subtracted; see :mod:`~sextant.retrieval.without_mean`. Matches then have
                no confidence, since the temperature was fitted without centring.
            sequence: number of photos in a sequence; None for single photos only.
            same: for each photo of the map, the photos of its place; by :attr:`tolerance` unless given.
            progress: called with the number of queries done and the total.

        Raises:
            UserError: the map is empty, or the two rides are too long for sequences.
        """
        check_whole("k", k, 1, "For example k=5")
        described = self.described
        same = self._same_place(described) if same is None else same
        reference = described.index
        if centring != "none":
            parts = centred(reference.references.rows, queries.references.rows, centring)
            reference, queries = (FlatIndex(rows) for rows in parts)
        return match(
            reference, queries, same, min(k, len(reference)),
            temperature=self.temperature.value if centring == "none" else None, sequence=sequence, progress=progress,
        )  # fmt: skip

    def pairs(self, k: int = 20) -> list[tuple[Path, Path]]:
        """Pair each photo of the map with the k others most similar to it, which may show the same place.

        :func:`~sextant.chapters.places.written_matches.write_pairs` writes the pairs for COLMAP.

        Raises:
            ArgumentError: k is not a whole number of at least 1.
            UserError: the map is empty.
        """
        check_whole("k", k, 1, "For example k=20")
        described = self.described
        found, paths = self.match(described.index, k + 1).neighbours.indices, described.paths
        others = ([other for other in row if other != i][:k] for i, row in enumerate(found.tolist()))
        return [(paths[i], paths[other]) for i, row in enumerate(others) for other in row]

    def _same_place(self, described: DescribedPhotos) -> Positives:
        """Which photos of the map show the same place; cached until the map or the tolerance changes."""
        usual = 0.0 if described.positions is None else self.tolerances["m"].positive
        tolerance = usual if self.tolerance is None else self.tolerance
        if self._same is None or self._same[0] is not described or self._same[1] != tolerance:
            self._same = described, tolerance, same_place(described, tolerance)
        return self._same[2]


def _positions(positions: Any, photos: int) -> Float64[ndarray, "n 2"]:
    fix = "Give x and y in metres for each photo, nan where unknown."
    try:
        where = np.array(detached(positions), np.float64)
    except (TypeError, ValueError, RuntimeError):
        raise ArgumentError(f"positions={shown(positions)} must be numbers, x and y for each photo", fix) from None
    if where.shape != (photos, 2):
        raise ArgumentError(f"positions has shape {where.shape} for {counted(photos, 'photo')}", fix)
    if np.isinf(where).any():
        raise ArgumentError(f"positions: the position of photo {np.isinf(where).any(1).argmax()} is infinite", fix)
    return where


def _part(photos: PhotoFolder, found: Described, positions: ndarray | None) -> DescribedPhotos:
    names, good = photos.names, [i for i in range(len(photos)) if i not in found.failed]
    return DescribedPhotos(
        photos,
        FlatIndex(found.rows, names=[names[i] for i in good]),
        {names[i]: why for i, why in found.failed.items()},
        tuple(names[i] for i in found.stretched),
        None if positions is None else positions[good],
    )


def failed_photo(name: str, why: str) -> FailedPhoto:
    """A photo that could not be described."""
    return FailedPhoto(name, UserError(f"{name}: {why}", "Replace the file, or leave it out."))


def _size_of(describer: Any) -> ImageSize:
    if isinstance(size := getattr(describer, "size", None), ImageSize):
        return size
    try:
        return ImageSize(int(describer.height), int(describer.width))
    except AttributeError:
        raise ArgumentError(
            "size=None: this descriptor does not state the size of its images", "For example size=ImageSize(64, 96)"
        ) from None
