"""From a folder of map photos and one of queries to files of matches."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sextant.applications.places.describing import (
    LARGEST_STRETCH,
    DescribedPhotos,
    PlaceDescriber,
    describe_photos,
)
from sextant.applications.places.known_places import KnownPlaces, check_truth, known_places
from sextant.applications.places.matching import check_rides, match
from sextant.applications.places.options import PlaceOptions
from sextant.applications.places.photo_folder import PhotoFolder
from sextant.applications.places.rows import counts, query_rows
from sextant.applications.places.run_facts import Temperature
from sextant.applications.places.saved_map import load_map, save_map
from sextant.cli.output_folder import telling_write_errors
from sextant.cli.place_matching import telling
from sextant.cli.place_matching.gallery_pages import write_gallery
from sextant.cli.place_matching.inputs import PlaceInputs, refuse_overlap
from sextant.cli.place_matching.written_files import write_matches
from sextant.cli.work_progress import work_progress


def predict_places(
    network: PlaceDescriber,
    inputs: PlaceInputs,
    temperature: Temperature,
    test_tolerance: Any,
    run: Mapping[str, Any],
) -> list[dict[str, Any]]:
    """Match places, write everything into ``output`` and tell it; a photo that fails is named and the rest go on.

    Args:
        network: describes photos.
        inputs: see there.
        temperature: of the posterior over the map.
        test_tolerance: of one place in the run's test, by unit.
        run: facts of the run, for ``matches.json``.

    Raises:
        UserError: no photo of the map or no query could be used, photos lack what ``places=`` names, descriptors are of
            another network, or the disk is full.
    """
    output, options = inputs.output, inputs.options
    reference = _map(network, inputs)
    with work_progress("describing queries", "photos") as progress:
        queries = describe_photos(network, inputs.queries, "queries", progress)
    if options.descriptors:
        with telling_write_errors(output / "queries"):
            save_map(queries, network.model, output / "queries")
    places = known_places(reference, queries, options, test_tolerance)
    k = min(options.matches, len(reference.index))
    with work_progress("looking up", "queries") as progress:
        found = match(
            reference.index,
            queries.index,
            places.same_place,
            k,
            temperature=temperature.value,
            sequence=options.sequence,
            progress=progress,
        )
    rows = query_rows(reference, queries, places, found)
    counted = counts(rows)
    described = {"map": reference, "queries": queries}
    remarks = _remarks(described, options, places, temperature, counted)
    facts = {
        "run": run,
        "temperature": temperature.value,
        "matches": k,
        "sequence": options.sequence,
        "places": options.places,
        "tolerance": places.tolerance.name,
        "counts": counted,
        "remarks": remarks,
        **{key: _photo_facts(photos) for key, photos in described.items()},
    }
    write_matches(rows, facts, output)
    with work_progress("drawing", "pages") as progress:
        pages = write_gallery(rows, reference, queries, places, output, progress)
    kept = [path for path in (output / "map", output / "queries") if options.descriptors and path.is_dir()]
    telling.tell(rows, counted, described, remarks, [output / "matches.csv", output / "matches.json", *pages, *kept])
    return rows


def _map(network: PlaceDescriber, inputs: PlaceInputs) -> DescribedPhotos:
    """The map's descriptors; those of photos are kept as soon as they are known, so that Ctrl-C costs little."""
    if isinstance(inputs.reference, Path):
        reference = load_map(inputs.reference, network.model)
        refuse_overlap(reference.photos, inputs.queries)
        _check(reference.photos, inputs)
        return reference
    _check(inputs.reference, inputs)
    with work_progress("describing the map", "photos") as progress:
        reference = describe_photos(network, inputs.reference, "map", progress)
    if inputs.options.descriptors:
        with telling_write_errors(inputs.output / "map"):
            save_map(reference, network.model, inputs.output / "map")
    return reference


def _check(reference: PhotoFolder, inputs: PlaceInputs) -> None:
    """Raise a ``UserError`` for what is wrong with the photos as a whole; to be told before they are described."""
    check_truth(reference, inputs.queries, inputs.options)
    check_rides(len(reference), len(inputs.queries), inputs.options.sequence)


def _remarks(
    described: Mapping[str, DescribedPhotos],
    options: PlaceOptions,
    places: KnownPlaces,
    temperature: Temperature,
    counted: Mapping[str, Any],
) -> list[str]:
    """What a reader of the figures should know."""
    told = []
    if temperature.value is None:
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
    return told + ([places.remark] if places.remark else [])


def _photo_facts(described: DescribedPhotos) -> dict[str, Any]:
    return {
        "folder": str(described.photos.folder),
        "photos": len(described.photos),
        "described": len(described.index),
        "failed": [{"photo": name, "error": why} for name, why in described.failed.items()],
        "stretched": list(described.stretched),
    }
