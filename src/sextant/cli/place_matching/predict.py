"""Matches a folder of queries with a folder of map photos and writes the matches to files."""

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sextant.applications.inspection.suggestion import overrides_of
from sextant.applications.places.describing import LARGEST_STRETCH, DescribedPhotos
from sextant.applications.places.gallery_pages import write_gallery
from sextant.applications.places.image_pairs import write_row_pairs
from sextant.applications.places.known_places import KnownPlaces, check_truth, known_places
from sextant.applications.places.matching import check_rides
from sextant.applications.places.photo_folder import PhotoFolder
from sextant.applications.places.place_map import PlaceMap
from sextant.applications.places.rows import counts, query_rows
from sextant.applications.places.run_facts import Temperature
from sextant.applications.places.written_matches import write_matches
from sextant.applications.write_errors import telling_write_errors
from sextant.cli.place_matching import telling
from sextant.cli.place_matching.inputs import PlaceInputs, refuse_overlap
from sextant.cli.place_matching.options import PlaceOptions
from sextant.cli.work_progress import work_progress
from sextant.data.unusable_files import nothing_usable
from sextant.errors import UserError


def predict_places(places: PlaceMap, inputs: PlaceInputs, run: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Match places, write the results into ``output`` and show them; failed photos are named and skipped.

    Args:
        places: an empty map.
        inputs: photos and options.
        run: facts of the run, for ``matches.json``.

    Raises:
        UserError: no photo of the map or no query could be used, photos lack what ``places=`` names, descriptors are of
            another network, or the disk is full.
    """
    output, options = inputs.output, inputs.options
    _fill(places, inputs)
    asked = PlaceMap(places.descriptor, places.size)
    _add(asked, "queries", inputs.queries, inputs)
    reference, queries = places.described, asked.described
    known = known_places(reference, queries, options.places, places.tolerances, options.tolerance)
    with work_progress("looking up", "queries") as progress:
        found = places.match(
            queries.index,
            options.matches,
            centring=options.centring,
            sequence=options.sequence,
            same=known.same_place,
            progress=progress,
        )
    rows = query_rows(reference, queries, known, found)
    counted = counts(rows)
    described = {"map": reference, "queries": queries}
    remarks = _remarks(described, options, known, places.temperature, counted)
    if options.places != "none":
        remarks.append(f"beside training-free descriptors: {_comparison(places, inputs, known, run)}")
    facts = {
        "run": run,
        "temperature": places.temperature.value,
        "matches": found.neighbours.indices.shape[1],
        "sequence": options.sequence,
        "centring": options.centring,
        "places": options.places,
        "tolerance": known.tolerance.name,
        "counts": counted,
        "remarks": remarks,
        **{key: photos.facts() for key, photos in described.items()},
    }
    write_matches(rows, facts, output)
    with work_progress("drawing", "pages") as progress:
        pages = write_gallery(rows, reference, queries, known, output, progress)
    kept = [path for path in (output / "map", output / "queries") if options.descriptors and path.is_dir()]
    if options.colmap:
        kept.append(write_row_pairs(rows, reference.photos.folder, queries.photos.folder, output))
    telling.tell(rows, counted, described, remarks, [output / "matches.csv", output / "matches.json", *pages, *kept])
    return rows


def _fill(places: PlaceMap, inputs: PlaceInputs) -> None:
    """Describe the map's photos or load their descriptors; general mistakes are reported before any is described."""
    if isinstance(inputs.reference, Path):
        try:
            places.take(inputs.reference)
        except UserError as error:
            raise UserError(
                f"map={inputs.reference}: {error.problem}",
                "Describe the map's photos anew: map=<folder of photos> descriptors=true",
            ) from None
        refuse_overlap(places.described.photos, inputs.queries)
    reference = places.described.photos if isinstance(inputs.reference, Path) else inputs.reference
    check_truth(reference, inputs.queries, inputs.options.places)
    check_rides(len(reference), len(inputs.queries), inputs.options.sequence)
    if isinstance(inputs.reference, PhotoFolder):
        _add(places, "map", inputs.reference, inputs)


def _add(places: PlaceMap, key: str, photos: PhotoFolder, inputs: PlaceInputs) -> None:
    """Describe photos and save the descriptors at once, so that Ctrl-C loses little."""
    with work_progress(f"describing {'the map' if key == 'map' else key}", "photos") as progress:
        failed = places.add(photos, errors="return", progress=progress)
    if not len(places):
        named = {
            Path(each.name).relative_to(photos.folder).as_posix(): each.error.problem.removeprefix(f"{each.name}: ")
            for each in failed
        }
        raise nothing_usable(f"{key}={photos.folder}: none of {len(photos):,} photos can be used", named)
    if inputs.options.descriptors:
        with telling_write_errors(inputs.output / key):
            places.save(inputs.output / key, descriptor=False)


def _remarks(
    described: Mapping[str, DescribedPhotos],
    options: PlaceOptions,
    places: KnownPlaces,
    temperature: Temperature,
    counted: Mapping[str, Any],
) -> list[str]:
    """Remarks for the reader of the results."""
    told = []
    if options.centring != "none":
        told.append(f"no confidence: the temperature is of descriptors as they are, not of centring={options.centring}")
    elif temperature.value is None:
        told.append(f"no confidence, similarities only: {temperature.lacking}")
    else:
        told.append(f"{telling.SUPPOSED} (temperature {temperature.value:.4g}, fitted on the run's validation split)")
        if options.sequence:
            told.append("the temperature is of single photos: matches by sequences have no confidence")
    if options.places == "none" and places.tolerance.positive < 1:
        told.append(telling.ALONE)
    for key, photos in described.items():
        if photos.stretched:
            told.append(
                f"{key}: {len(photos.stretched):,} photos, such as {photos.stretched[0]}, have another shape "
                f"than the network's images: stretched to it by a factor above {LARGEST_STRETCH}"
            )
    if options.matches > len(described["map"].index):
        told.append(f"matches={options.matches}: the map has only {len(described['map'].index):,} images")
    if counted["same_file"]:
        told.append(
            f"{counted['same_file']:,} queries are copies of their best match, which says nothing of the network"
        )
    return [*told, *places.remarks]


def _comparison(places: PlaceMap, inputs: PlaceInputs, known: KnownPlaces, run: Mapping[str, Any]) -> str:
    """The command that tests the network and baselines on the same two folders."""
    chosen, size = known.tolerance, places.size
    heading = "null" if chosen.heading_deg is None else f"{chosen.heading_deg:g}"
    described = {"map": places.described.photos, "queries": inputs.queries}
    folders = overrides_of({name: photos.folder.absolute() for name, photos in described.items()})
    words = [
        *("sextant", "evaluate", f"run={run['run']}", "dataset=place_folders", "dataset.folder=."),
        *(f"dataset.test={folders}", "dataset.skip_bad=true", "task.baselines=true"),
        *(f"dataset.{key}={getattr(size, key)}" for key in ("height", "width", "channels")),
        f"dataset.places={inputs.options.places}",
        f"task.test_tolerance.{chosen.unit}={{positive: {chosen.positive:g}, negative: {chosen.negative:g}, "
        f"heading_deg: {heading}}}",
    ]
    return shlex.join(words)
