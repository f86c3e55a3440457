"""A map of photos, in which other photos are looked up."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self, TypeAlias, overload

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from sextant.applications.arguments import check_whole
from sextant.applications.failures import Errors, FailedPhoto, raise_failed, several
from sextant.applications.pixels import AnyImage, as_pixels
from sextant.atomic_files import hash_file
from sextant.chapters.places.data.tolerance import PlaceTolerance
from sextant.chapters.places.described_map import DESCRIPTOR, DescribedMap, failed_photo, silent
from sextant.chapters.places.describing import describe
from sextant.chapters.places.given_descriptors import GivenDescriptors, given_rows
from sextant.chapters.places.looked_up import LookedUp, looked_up
from sextant.chapters.places.match_confidence import CANDIDATES, RERANKED, deviations
from sextant.chapters.places.matching import Matches
from sextant.chapters.places.photo_features import (
    Kind,
    PhotoFeatures,
    extractor_of,
    header_of,
    save_features,
    saved_features,
    stored_kinds,
)
from sextant.chapters.places.photo_folder import PhotoFolder
from sextant.chapters.places.reranked_matches import rerank
from sextant.chapters.places.saved_descriptor import Describes, kept_network, load_descriptor
from sextant.chapters.places.saved_map import (
    ELSEWHERE,
    FITTED,
    TOLERANCES,
    Temperature,
    fitted_confidence,
    read_facts,
    run_temperature,
)
from sextant.errors import UserError
from sextant.evaluation.positives import Positives
from sextant.kit.published_places import CARD
from sextant.kit.trained import own_config, read_trained
from sextant.reporter import Advance
from sextant.retrieval import FlatIndex, flat_index
from sextant.retrieval.without_mean import Centring
from sextant.runs.checkpoint import KEY
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.resolve import FoundRun, resolve_run

if TYPE_CHECKING:
    from sextant.correspondence import LocalFeatureExtractor

#: local features by name, or what extracts them
Local: TypeAlias = "LocalFeatureExtractor | str"


class PlaceMap(DescribedMap):
    """Photos of known places, in which the place of another photo is looked up.

    Photos of the map are image files of any kind; photos that are looked up may also be bytes, as arrays, lists or
    Pillow images. They may have any size; they are turned upright by EXIF and stretched to the size of the network's
    images. The map keeps only the descriptors and names of its files.

    The confidence of a match is the posterior of its place over the map, at the temperature that the run's test fitted
    (see :mod:`~sextant.chapters.places.matching`). It assumes that the place is in the map.

    >>> places = PlaceMap.load("outputs/runs/place_recognition/1a2b3c4d-s0")  # doctest: +SKIP
    >>> places.add("photos/day")  # doctest: +SKIP
    >>> best = places.look_up("photos/night/7.jpg").best  # doctest: +SKIP
    >>> print(best.photo, best.similarity, best.confidence)  # doctest: +SKIP

    Args:
        descriptor: describes the images: a descriptor of :mod:`sextant.baselines` that is fitted or needs no fitting,
            the name of one (``"Hog"``), or any object with ``describe``.
        size: size of the images that it takes; by default its own ``size``, or ``height`` and ``width``.
        temperature: temperature of the posterior over the map, above 0; without it matches have no confidence.
        tolerances: what counts as one place, in metres and in photos along a ride.

    Raises:
        ArgumentError: the size is unknown or not an ``ImageSize``, the descriptor takes only vectors, or the
            temperature is not above 0.
    """

    _features: PhotoFeatures | None = None  # the kind that was used last
    _local: "Local | None" = None
    _kinds: Mapping[str, PhotoFeatures] = {}  # all kinds that were used, by model
    _opened: "tuple[Path, dict[str, Path], str] | None" = None  # folder that was loaded, its files, hash of its index

    @classmethod
    def load(cls, run: Path | str, outputs: Path | str | None = None, *, trust: bool = False) -> Self:
        """Create an empty map whose photos are described by the network of a run.

        Args:
            run: an MLflow run id, a run directory or its name, a checkpoint, or the file of a published network
                (:mod:`~sextant.models.published_place_file`).
            outputs: folder of runs; the folder that runs are written to by default.
            trust: build user-defined parts that the checkpoint names.

        Raises:
            UserError: there is no such run, its file is damaged, or it is of another task.
        """
        found = resolve_run(str(run), default_outputs() if outputs is None else Path(outputs).expanduser())
        return cls.of(read_trained(found.checkpoint), found, trust=trust)

    @classmethod
    def of(cls, content: Mapping[str, Any], found: FoundRun, *, trust: bool = False) -> Self:
        """Create an empty map for a run's checkpoint that has been read already.

        Raises:
            UserError: as for :meth:`load`.
        """
        trained = content[KEY]
        if trained["task"] != "place_recognition":
            raise UserError(f"{found.checkpoint} is a model of {trained['task']}, not of place_recognition")
        task: Any = own_config(trained, trust=trust).task
        tolerances = {
            unit: PlaceTolerance(unit, **getattr(task.test_tolerance, unit).model_dump()) for unit in TOLERANCES
        }
        kept = kept_network(found.checkpoint, content, trust=trust)
        own = trained["spec"].get(FITTED, {}).get("temperature")
        temperature = run_temperature(found) if own is None else Temperature(own)
        if CARD in trained:
            temperature = ELSEWHERE
        return cls(kept, temperature=temperature, tolerances=tolerances)

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
        """Open a saved map.

        Args:
            folder: folder that the map was saved to, or that ``predict.py`` wrote with ``descriptors=true``.
            run: run whose network describes photos, for a map that was saved without it.
            outputs: folder of runs; the folder that runs are written to by default.
            descriptor: descriptor of photos, for a map whose descriptor could not be saved.
            trust: build user-defined parts that a network's config names.

        Raises:
            UserError: there is no map, it is damaged, or its network is not that of the run.
        """
        folder = Path(str(folder)).expanduser()
        facts = read_facts(folder)
        if run is not None:
            places = cls.load(run, outputs, trust=trust)
        elif descriptor is not None or facts.descriptor:
            kept = descriptor or load_descriptor(folder / DESCRIPTOR, trust=trust)
            places = cls(kept, facts.size, temperature=facts.temperature, tolerances=facts.tolerances)
        else:
            raise UserError(
                f"the map in {folder} was saved without its descriptor",
                "Name the run of its network: PlaceMap.open(folder, run=...)",
            )
        places.tolerance = facts.tolerance
        return places.take(folder)

    @classmethod
    def of_descriptors(
        cls,
        photos: PhotoFolder | Path | str | Iterable[Path | str],
        descriptors: Float[ndarray, "n d"] | Path | str,
        positions: Float[ndarray, "n 2"] | Sequence[Sequence[float]] | None = None,
    ) -> Self:
        """Create a map of photos whose descriptors were computed elsewhere; its queries are given in the same way.

        Args:
            photos, positions: as for :meth:`add`; the files are not read.
            descriptors: of each photo in the same order: an array, or a file of ``numpy.save``.

        Raises:
            UserError: the descriptors are not finite rows of floats, one per photo.

        >>> places = PlaceMap.of_descriptors("day", "day.npy")  # doctest: +SKIP
        >>> places.look_up_descriptors("night.npy")[0].best  # doctest: +SKIP
        """
        rows = given_rows(descriptors, None)
        places = cls(GivenDescriptors(rows.shape[1]), temperature=ELSEWHERE)
        places.add(photos, positions, descriptors=rows)
        return places

    def look_up_descriptors(
        self, descriptors: Float[ndarray, "n d"] | Path | str, k: int = 5, *, centring: Centring = "none"
    ) -> list[LookedUp]:
        """Look up photos by their descriptors, computed elsewhere by the network of the map.

        Args:
            descriptors: one row per photo: an array, or a file of ``numpy.save``; results are named by their row.
            k, centring: as for :meth:`look_up_many`.

        Raises:
            UserError: the descriptors are not finite rows of floats, or of other length than the map's.
        """
        described, rows = self.described, self.given(descriptors)
        found = self.match(FlatIndex(rows), k, centring=centring)
        sure = self.found(found) if centring == "none" else None
        names = [f"row {i}" for i in range(len(rows))]
        return looked_up(names, [False] * len(rows), described, found, sure)

    def save(self, folder: Path | str, *, descriptor: bool = True) -> None:
        """Write the map as :meth:`DescribedMap.save` does, with all local features that are known of its photos."""
        kept = [] if self._opened is None else stored_kinds(*self._opened)
        kept += [Kind(each.extractor.name, model, each.kept) for model, each in self._kinds.items()]
        described, folder = self.described, Path(str(folder)).expanduser()
        names = dict(zip(described.paths, described.names, strict=True))
        for kind in kept:  # what cannot be saved is told while the map that was there is whole
            header_of(kind, names)
        super().save(folder, descriptor=descriptor)
        index = hash_file(folder / flat_index.HEADER)
        save_features(kept, names, folder, index)
        if self._opened is not None and self._opened[0].resolve() == folder.resolve():
            self._opened = folder.absolute(), {name: file for file, name in names.items()}, index

    def take(self, folder: Path) -> Self:
        """Load the photos of a saved map into this one, replacing its own; their local features are read on demand."""
        super().take(folder)
        files = dict(zip(self.described.names, self.described.paths, strict=True))
        self._opened = folder.absolute(), files, hash_file(folder / flat_index.HEADER)
        self._features, self._kinds = None, {}
        return self

    def look_up(self, photo: AnyImage, k: int = 5, rerank: int | None = None, local: Local = "xfeat") -> LookedUp:
        """Find the photos of the map that show the place of a photo.

        Args:
            photo: a file, an array of values from 0 to 255, or a Pillow image.
            k: number of matches, at least 1; a smaller map returns all its photos.
            rerank: number of best matches that are re-ranked by local features, which are read from the map's files
                (:mod:`sextant.correspondence.reranking`) once, and saved with the map; None: not re-ranked.
            local: the local features: ``xfeat``; ``trunk``, the activations of the map's own network;
                ``aliked:<folder>``; ``none`` does not re-rank; or an object that extracts features.

        Raises:
            UserError: the photo cannot be read, the map is empty, or files to re-rank are missing.
        """
        (found,) = self.look_up_many([photo], k, rerank, local, errors="return")
        if isinstance(found, FailedPhoto):
            raise found.error
        return found

    @overload
    def look_up_many(
        self,
        photos: Iterable[AnyImage],
        k: int = 5,
        rerank: int | None = None,
        local: Local = "xfeat",
        *,
        centring: Centring = "none",
        errors: Literal["raise"] = "raise",
    ) -> list[LookedUp]: ...
    @overload
    def look_up_many(
        self,
        photos: Iterable[AnyImage],
        k: int = 5,
        rerank: int | None = None,
        local: Local = "xfeat",
        *,
        centring: Centring = "none",
        errors: Literal["return"],
    ) -> list[LookedUp | FailedPhoto]: ...
    def look_up_many(
        self,
        photos: Iterable[AnyImage],
        k: int = 5,
        rerank: int | None = None,
        local: Local = "xfeat",
        *,
        centring: Centring = "none",
        errors: Errors = "raise",
    ) -> list[LookedUp] | list[LookedUp | FailedPhoto]:
        """Look up several photos individually; the results are in the same order.

        Args:
            photos: files, bytes or Pillow images.
            k, rerank, local: as for :meth:`look_up`.
            centring: for photos of one ride: which mean descriptor is subtracted, as for :meth:`match`.
            errors: ``raise`` tries all photos, then raises if some failed; ``return`` puts a :class:`FailedPhoto` in
                the place of each that did.

        Raises:
            FailedPhotosError: photos failed; the message names all of them.
            ArgumentError: k or rerank is not a whole number of at least 1, or ``photos`` is not a collection of photos.
            UserError: the map is empty, or files to re-rank are missing.
        """
        return self._look_up(photos, k, None, errors, centring, None if local == "none" else rerank, local)

    @overload
    def look_up_sequence(
        self, photos: Iterable[AnyImage], k: int = 5, *, length: int = 10, errors: Literal["raise"] = "raise"
    ) -> list[LookedUp]: ...
    @overload
    def look_up_sequence(
        self, photos: Iterable[AnyImage], k: int = 5, *, length: int = 10, errors: Literal["return"]
    ) -> list[LookedUp | FailedPhoto]: ...
    def look_up_sequence(
        self, photos: Iterable[AnyImage], k: int = 5, *, length: int = 10, errors: Errors = "raise"
    ) -> list[LookedUp] | list[LookedUp | FailedPhoto]:
        """Look up the photos of a ride, each together with those before it.

        The map must be a ride too, in the order in which photos were added; see
        :mod:`sextant.retrieval.sequence_matching`. A photo that fails is left out of the ride.

        Args:
            photos: as for :meth:`look_up_many`, in the order of the ride.
            k: as for :meth:`look_up`.
            length: number of photos in a sequence, at least 2.
            errors: as for :meth:`look_up_many`.

        Raises:
            FailedPhotosError: photos failed; the message names all of them.
            UserError: the map is empty, or the two rides are too long to be compared.
        """
        check_whole("length", length, 2, "For example length=10")
        return self._look_up(photos, k, length, errors)

    def reranked(
        self,
        found: Matches,
        k: int,
        candidates: int,
        queries: Sequence[AnyImage],
        progress: Advance = silent,
        local: Local = "xfeat",
        same: Positives | None = None,
    ) -> Matches:
        """Re-rank matches by local features, which stay in memory for the map's photos.

        Args:
            found: matches in this map.
            k: number of matches to keep.
            candidates: number of best matches that are re-ranked.
            queries: photos of the queries.
            progress: called with the number of queries done and the total.
            local: as for :meth:`look_up`.
            same: as for :meth:`match`.

        Raises:
            UserError: files of the map are missing, or the features need a package that is not installed.
        """
        described = self.described
        same = self._same_place(described) if same is None else same
        return rerank(found, k, candidates, queries, described.paths, self.features(local), same, progress)

    def features(self, local: Local = "xfeat") -> PhotoFeatures:
        """The local features of the map's photos, of the kind that was used last or is asked for.

        Raises:
            ArgumentError: there is no such kind, or its weights or packages are missing.
        """
        if self._features is None or self._local != local:
            extractor = extractor_of(local, self._describer)
            if extractor.model not in self._kinds:
                saved = {} if self._opened is None else saved_features(self._opened[0], extractor, *self._opened[1:])
                self._kinds = {**self._kinds, extractor.model: PhotoFeatures(extractor, saved)}
            self._features, self._local = self._kinds[extractor.model], local
        return self._features

    def found(self, matches: Matches) -> Float64[ndarray, "m"] | None:
        """Probability that each best match shows the place of its query, which need not be in the map.

        nan where it is unknown: without re-ranking in a map of one place, and with it by other features than XFeat's
        at their own settings, with fewer than 15 candidates of a larger map, without one of another place, or of
        photos below 90 pixels. None for descriptors other than networks.
        """
        fitted = fitted_confidence(self.descriptor.facts)
        if fitted is None:
            return None
        if matches.evidence is None:
            return fitted.probability(matches.margin)
        from sextant.correspondence import XFeatures

        told = matches.evidence
        usual = self._features is not None and self._features.extractor.model == XFeatures().model
        if not usual or told.compared < min(CANDIDATES, len(self)):
            return np.full(len(matches.margin), np.nan)
        return RERANKED.probability(deviations(told.inliers, told.rival))

    def _look_up(
        self,
        photos: Iterable[AnyImage],
        k: int,
        sequence: int | None,
        errors: Errors,
        centring: Centring = "none",
        rerank: int | None = None,
        local: Local = "xfeat",
    ) -> list[LookedUp | FailedPhoto]:
        check_whole("k", k, 1, "For example k=5")
        if rerank is not None:
            check_whole("rerank", rerank, 1, "For example rerank=15")
        photos, described = several(photos, errors), self.described
        if rerank is not None:
            self.features(local)  # wrong features are reported before the work
        size = (self.size.height, self.size.width, self.size.channels)
        names: list[str] = []
        originals: dict[int, AnyImage] = {}
        given: dict[int, Path | ndarray] = {}
        results: dict[int, LookedUp | FailedPhoto] = {}
        for i, photo in enumerate(photos):
            names.append(str(Path(photo).expanduser()) if isinstance(photo, Path | str) else f"photo {i}")
            if rerank is not None:
                originals[i] = Path(names[i]) if isinstance(photo, Path | str) else photo
            try:
                given[i] = Path(names[i]) if isinstance(photo, Path | str) else as_pixels(photo, size)
            except UserError as error:
                results[i] = FailedPhoto(names[i], error)
        numbers = list(given)
        found = describe(self._describer, self.size, list(given.values()))
        results |= {numbers[j]: failed_photo(names[numbers[j]], why) for j, why in found.failed.items()}
        raise_failed((each for _, each in sorted(results.items())), len(names), "looked up", errors)
        good = [i for i in numbers if i not in results]
        if good:
            far = {numbers[j] for j in found.stretched}
            matches = self.match(FlatIndex(found.rows), max(k, rerank or 0), centring=centring, sequence=sequence)
            if rerank is not None:
                matches = self.reranked(matches, k, rerank, [originals[i] for i in good], local=local)
            sure = self.found(matches) if centring == "none" else None
            stretched = [i in far for i in good]
            results |= zip(good, looked_up([names[i] for i in good], stretched, described, matches, sure), strict=True)
        return [results[i] for i in range(len(names))]
