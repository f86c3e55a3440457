"""A map of photos, in which others are looked up."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Self, overload

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from sextant.applications.failures import Errors, FailedPhoto, check_errors, raise_failed, several
from sextant.applications.kept_descriptor import Describes, KeptDescriptor, kept_baseline, kept_network, load_descriptor
from sextant.applications.pixels import checked_pixels
from sextant.applications.places.describing import Described, DescribedPhotos, describe, joined, without_failed
from sextant.applications.places.known_places import same_place
from sextant.applications.places.looked_up import LookedUp, looked_up
from sextant.applications.places.matching import Matches, match
from sextant.applications.places.photo_folder import PhotoFolder, photo_folder
from sextant.applications.places.run_facts import Temperature, run_temperature
from sextant.applications.places.saved_map import TOLERANCES, MapFacts, load_map, read_facts, save_map
from sextant.data.places.decoded_images import ImageSize
from sextant.data.places.tolerance import PlaceTolerance, Unit
from sextant.errors import ArgumentError, UserError
from sextant.evaluation.places.positives import Positives
from sextant.reporter import Advance
from sextant.retrieval import FlatIndex
from sextant.runs.checkpoint import KEY
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.resolve import FoundRun, resolve_run
from sextant.trained.content import own_config, read_trained

AnyPhoto = Path | str | UInt8[ndarray, "h w *c"]
DESCRIPTOR = "descriptor"
NO_RUN = "the descriptor is no run's, whose test fits the temperature"


def silent(done: int, total: int) -> None:
    """Tell nobody how far the work is."""


class PlaceMap:
    """Photos whose places are known, and which of them show the place of another photo.

    Photos are files of any kind and size, turned upright by EXIF and stretched to the size of the network's images, or
    arrays of bytes of that size. Of the map only descriptors are kept.

    The confidence of a match is the posterior of its place over the map at the temperature that the run's test fitted
    (see :mod:`~sextant.applications.places.matching`). It supposes that the place is in the map.

    >>> places = PlaceMap.load("outputs/runs/place_recognition/1a2b3c4d-s0")  # doctest: +SKIP
    >>> places.add("photos/day")  # doctest: +SKIP
    >>> best = places.look_up("photos/night/7.jpg").best  # doctest: +SKIP
    >>> print(best.photo, best.similarity, best.confidence)  # doctest: +SKIP

    Args:
        descriptor: what describes images: one of :mod:`sextant.baselines` that need not be fitted or was, or anything
            with ``describe``.
        size: of the images that it takes; by default its own ``size``, or ``height`` and ``width``.
        temperature: of the posterior over the map, above 0; without it matches have no confidence.
        tolerances: what counts as one place, in metres and in photos along a ride.

    Attributes:
        tolerance: largest distance of one place, whose photos share its confidence: in metres where photos were added
            with positions, else in photos along a ride. None is the run's in metres, and 0 photos.

    Raises:
        ArgumentError: the size is not known, the descriptor takes vectors alone, or the temperature is not above 0.
    """

    def __init__(
        self,
        descriptor: Describes | KeptDescriptor,
        size: ImageSize | None = None,
        *,
        temperature: Temperature | float | None = None,
        tolerances: Mapping[Unit, PlaceTolerance] = TOLERANCES,
    ):
        self.descriptor = descriptor if isinstance(descriptor, KeptDescriptor) else kept_baseline(descriptor)
        if self.descriptor.describer is None:
            raise ArgumentError("descriptor: it describes no images", "Give one of sextant.baselines, or a network.")
        self._describer = self.descriptor.describer
        self.size = size or _size_of(self._describer)
        self.model = self.descriptor.model
        told = temperature if isinstance(temperature, Temperature) else Temperature(temperature, NO_RUN)
        if told.value is not None and not told.value > 0:
            raise ArgumentError(f"temperature={told.value:g} must be above 0", "For example temperature=0.05")
        self.temperature, self.tolerances = told, dict(tolerances)
        self.tolerance: float | None = None
        self._parts: list[DescribedPhotos] = []
        self._files: set[Path] = set()
        self._same: tuple[DescribedPhotos, float, Positives] | None = None

    # -- from a run --------------------------------------------------------------------------------------------------

    @classmethod
    def load(cls, run: Path | str, outputs: Path | str | None = None, *, trust: bool = False) -> Self:
        """An empty map, whose photos the network of a run describes.

        Args:
            run: an MLflow run id, a run directory or its name, or a checkpoint.
            outputs: folder of runs; where runs are written unless given.
            trust: build parts of the user's own that the checkpoint names.

        Raises:
            UserError: there is no such run, its file is damaged, or it is one of another task.
        """
        found = resolve_run(str(run), default_outputs() if outputs is None else Path(outputs).expanduser())
        return cls.of(read_trained(found.checkpoint), found, trust=trust)

    @classmethod
    def of(cls, content: Mapping[str, Any], found: FoundRun, *, trust: bool = False) -> Self:
        """An empty map for the checkpoint of a run, which was read.

        Raises:
            UserError: as :meth:`load`.
        """
        trained = content[KEY]
        if trained["task"] != "place_recognition":
            raise UserError(f"{found.checkpoint} is a model of {trained['task']}, not of place_recognition")
        task: Any = own_config(trained, trust=trust).task
        tolerances = {
            unit: PlaceTolerance(unit, **getattr(task.test_tolerance, unit).model_dump()) for unit in TOLERANCES
        }
        kept = kept_network(found.checkpoint, content, trust=trust)
        return cls(kept, temperature=run_temperature(found), tolerances=tolerances)

    # -- the map -----------------------------------------------------------------------------------------------------

    def __len__(self) -> int:
        """How many photos there are to be found."""
        return sum(len(part.index) for part in self._parts)

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
        errors: Errors = "raise",
        progress: Advance = silent,
    ) -> list[FailedPhoto]:
        """Add photos to the map.

        Args:
            photos: a folder, whose photos are added in the natural order of their names, a file, or files.
            positions: x and y of each in metres, in the same order; nan where one is not known.
            errors: ``raise`` adds what can be described, then raises if some photos could not; ``return`` returns
                these.
            progress: called with the photos done and all.

        Returns:
            The photos that could not be described, of which the map has the names alone.

        Raises:
            FailedPhotosError: photos could not be described; it names all of them, and the others are in the map.
            ArgumentError: there are no photos, some are in the map already, or there are not as many positions.
        """
        check_errors(errors)
        given = photo_folder(photos)
        where = None if positions is None else np.array(positions, np.float64)
        if where is not None and where.shape != (len(given), 2):
            raise ArgumentError(
                f"positions has shape {where.shape} for {len(given):,} photos", "Give x and y in metres of each photo."
            )
        files = [path.absolute() for path in given.paths]
        if twice := [path for path, count in Counter([*files, *self._files.intersection(files)]).items() if count > 1]:
            raise ArgumentError(f"photos: {twice[0]} is in the map already", "Add each photo once.")
        found = describe(self._describer, self.size, given.paths, progress)
        failed = [_failed(str(given.paths[i]), why) for i, why in sorted(found.failed.items())]
        if len(found.rows):
            self._parts = [without_failed(part, set(files)) for part in self._parts] + [_part(given, found, where)]
            self._files |= {path.absolute() for path in self._parts[-1].paths}
        raise_failed(failed, len(given), "described", errors, "go on: the others are in the map.")
        return failed

    def save(self, folder: Path | str, *, descriptor: bool = True) -> None:
        """Write the map into a folder, without pickles; a map that was there is replaced.

        Args:
            folder: that is made if need be.
            descriptor: what describes photos is kept too, so that the folder opens by itself.

        Raises:
            UserError: the map is empty.
            OSError: the disk is full, or the folder cannot be written to.
        """
        folder = Path(folder).expanduser()
        kept = descriptor and self.descriptor.facts["kind"] != "none"
        described = self.described
        if kept:
            self.descriptor.save(folder / DESCRIPTOR)
        facts = MapFacts(self.model, kept, self.temperature, self.tolerance, self.tolerances, self.size)
        save_map(described, facts, folder)

    @classmethod
    def open(
        cls,
        folder: Path | str,
        run: Path | str | None = None,
        outputs: Path | str | None = None,
        *,
        descriptor: Describes | None = None,
        trust: bool = False,
    ) -> Self:
        """A map that was saved.

        Args:
            folder: that it was saved to, or that ``predict.py`` wrote with ``descriptors=true``.
            run: whose network describes photos, for a map that was saved without it.
            outputs: folder of runs; where runs are written unless given.
            descriptor: that describes photos, for a map of one that could not be kept.
            trust: build parts of the user's own that a network's config names.

        Raises:
            UserError: there is no map, it is damaged, or it is of another network than that of the run.
        """
        folder = Path(folder).expanduser()
        facts = read_facts(folder)
        if run is not None:
            places = cls.load(run, outputs, trust=trust)
        elif descriptor is not None or facts.descriptor:
            kept = descriptor or load_descriptor(folder / DESCRIPTOR, trust=trust)
            places = cls(kept, facts.size, temperature=facts.temperature, tolerances=facts.tolerances)
        else:
            raise UserError(
                f"the map in {folder} was saved without what describes photos",
                "Name the run of its network: PlaceMap.open(folder, run=...)",
            )
        places.tolerance = facts.tolerance
        return places.take(folder)

    def take(self, folder: Path) -> Self:
        """Put the photos of a map that was saved into this one, in place of those that it has.

        Raises:
            UserError: there is none, it is damaged, or its photos were described by another network.
        """
        described, facts = load_map(folder)
        if facts.model != self.model:
            raise UserError(
                f"the map in {folder} is of another network ({facts.model[:12]}) than the one given "
                f"({self.model[:12]}), and descriptors of two networks cannot be compared",
                "Name the run that the map was made with, or add its photos anew.",
            )
        self._parts, self._files = [described], {path.absolute() for path in described.paths}
        return self

    # -- looking up --------------------------------------------------------------------------------------------------

    def look_up(self, photo: AnyPhoto, k: int = 5) -> LookedUp:
        """The photos of the map that show the place of a photo.

        Args:
            photo: a file, or bytes of the size of the network's images.
            k: matches, at least 1; of a smaller map all.

        Raises:
            UserError: the photo cannot be read, or the map is empty.
        """
        (found,) = self.look_up_many([photo], k, errors="return")
        if isinstance(found, FailedPhoto):
            raise found.error
        return found

    @overload
    def look_up_many(
        self, photos: Iterable[AnyPhoto], k: int = 5, *, errors: Literal["raise"] = "raise"
    ) -> list[LookedUp]: ...
    @overload
    def look_up_many(
        self, photos: Iterable[AnyPhoto], k: int = 5, *, errors: Literal["return"]
    ) -> list[LookedUp | FailedPhoto]: ...
    def look_up_many(
        self, photos: Iterable[AnyPhoto], k: int = 5, *, errors: Errors = "raise"
    ) -> list[LookedUp] | list[LookedUp | FailedPhoto]:
        """Each photo by itself, in their order.

        Args:
            photos: files, or bytes of the size of the network's images.
            k: as for :meth:`look_up`.
            errors: ``raise`` tries all photos, then raises if some failed; ``return`` has a :class:`FailedPhoto` in the
                place of each that did.

        Raises:
            FailedPhotosError: photos failed; it names all of them.
            UserError: the map is empty.
        """
        return self._look_up(photos, k, None, errors)

    @overload
    def look_up_sequence(
        self, photos: Iterable[AnyPhoto], k: int = 5, *, length: int = 10, errors: Literal["raise"] = "raise"
    ) -> list[LookedUp]: ...
    @overload
    def look_up_sequence(
        self, photos: Iterable[AnyPhoto], k: int = 5, *, length: int = 10, errors: Literal["return"]
    ) -> list[LookedUp | FailedPhoto]: ...
    def look_up_sequence(
        self, photos: Iterable[AnyPhoto], k: int = 5, *, length: int = 10, errors: Errors = "raise"
    ) -> list[LookedUp] | list[LookedUp | FailedPhoto]:
        """The photos of a ride, each with those before it: the map is a ride too, in the order of adding.

        See :mod:`sextant.retrieval.sequence_matching`. A photo that fails is left out of the ride.

        Args:
            photos: as for :meth:`look_up_many`, in the order of the ride.
            k: as for :meth:`look_up`.
            length: photos of a sequence, at least 2.
            errors: as for :meth:`look_up_many`.

        Raises:
            FailedPhotosError: photos failed; it names all of them.
            UserError: the map is empty, or both rides are too long to be compared.
        """
        if length < 2:
            raise ArgumentError(f"length={length} must be at least 2", "For example length=10")
        return self._look_up(photos, k, length, errors)

    def match(
        self,
        queries: FlatIndex,
        k: int,
        *,
        sequence: int | None = None,
        same: Positives | None = None,
        progress: Advance = silent,
    ) -> Matches:
        """Look descriptors up, as arrays.

        Args:
            queries: their descriptors, in the order of their ride if sequences are asked for.
            k: matches, at least 1; of a smaller map all.
            sequence: photos of a sequence; None for single photos alone.
            same: of each photo of the map those of its place; by :attr:`tolerance` unless given.
            progress: called with the queries done and all.

        Raises:
            UserError: the map is empty, or both rides are too long for sequences.
        """
        if k < 1:
            raise ArgumentError(f"k={k} must be at least 1", "For example k=5")
        described = self.described
        same = self._same_place(described) if same is None else same
        return match(
            described.index, queries, same, min(k, len(described.index)),
            temperature=self.temperature.value, sequence=sequence, progress=progress,
        )  # fmt: skip

    def _same_place(self, described: DescribedPhotos) -> Positives:
        """Which photos of the map show one place, worked out once for as long as neither map nor tolerance changes."""
        usual = 0.0 if described.positions is None else self.tolerances["m"].positive
        tolerance = usual if self.tolerance is None else self.tolerance
        if self._same is None or self._same[0] is not described or self._same[1] != tolerance:
            self._same = described, tolerance, same_place(described, tolerance)
        return self._same[2]

    def _look_up(
        self, photos: Iterable[AnyPhoto], k: int, sequence: int | None, errors: Errors
    ) -> list[LookedUp | FailedPhoto]:
        photos, described = several(photos, errors), self.described
        size = (self.size.height, self.size.width, self.size.channels)
        given = [Path(p).expanduser() if isinstance(p, Path | str) else checked_pixels(p, size) for p in photos]
        names = [f"photo {i}" if isinstance(photo, ndarray) else str(photo) for i, photo in enumerate(given)]
        found = describe(self._describer, self.size, given)
        results: dict[int, LookedUp | FailedPhoto] = {i: _failed(names[i], why) for i, why in found.failed.items()}
        raise_failed((each for _, each in sorted(results.items())), len(given), "looked up", errors)
        good = [i for i in range(len(given)) if i not in found.failed]
        if good:
            matches = self.match(FlatIndex(found.rows), k, sequence=sequence)
            stretched = [i in found.stretched for i in good]
            results |= zip(good, looked_up([names[i] for i in good], stretched, described, matches), strict=True)
        return [results[i] for i in range(len(given))]


def _part(photos: PhotoFolder, found: Described, positions: ndarray | None) -> DescribedPhotos:
    names, good = photos.names, [i for i in range(len(photos)) if i not in found.failed]
    return DescribedPhotos(
        photos,
        FlatIndex(found.rows, names=[names[i] for i in good]),
        {names[i]: why for i, why in found.failed.items()},
        tuple(names[i] for i in found.stretched),
        None if positions is None else positions[good],
    )


def _failed(name: str, why: str) -> FailedPhoto:
    return FailedPhoto(name, UserError(f"{name}: {why}", "Replace the file, or leave it out."))


def _size_of(describer: Any) -> ImageSize:
    if isinstance(size := getattr(describer, "size", None), ImageSize):
        return size
    try:
        return ImageSize(int(describer.height), int(describer.width))
    except AttributeError:
        raise ArgumentError(
            "size=None: this descriptor does not tell the size of its images", "For example size=ImageSize(64, 96)"
        ) from None
