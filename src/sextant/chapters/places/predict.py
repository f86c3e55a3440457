"""Matches a folder of queries with a folder of map photos, writes the matches to files, and prints them."""

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sextant.applications.write_errors import telling_write_errors
from sextant.chapters.places.describing import LARGEST_STRETCH, DescribedPhotos
from sextant.chapters.places.known_places import KnownPlaces, check_truth, known_places
from sextant.chapters.places.matching import check_rides
from sextant.chapters.places.options import PlaceInputs, PlaceOptions, refuse_overlap
from sextant.chapters.places.photo_features import extractor_of
from sextant.chapters.places.photo_folder import PhotoFolder
from sextant.chapters.places.place_map import PlaceMap
from sextant.chapters.places.saved_map import Temperature
from sextant.chapters.places.written_matches import (
    check_pair_names,
    counts,
    query_rows,
    write_gallery,
    write_matches,
    write_row_pairs,
)
from sextant.config.override_words import overrides_of
from sextant.console.console import console, rows_table
from sextant.console.work_progress import work_progress
from sextant.console.written import tell_skipped, tell_written
from sextant.data.photo_files import nothing_usable
from sextant.errors import NAMED, UserError
from sextant.kit.published_places import CARD, card_text
from sextant.tables import counted


def predict_places(places: PlaceMap, inputs: PlaceInputs, run: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Match places, write the results into ``output`` and show them; failed photos are named and skipped.

    Args:
        places: an empty map.
        inputs: photos and options.
        run: facts of the run, for ``matches.json``.

    Raises:
        UserError: no photo of the map or no query could be used, photos lack what ``places=`` requires, descriptors are
            of another network, or the disk is full.
    """
    output, options = inputs.output, inputs.options
    candidates = None if options.local == "none" else options.rerank
    if candidates:
        extractor_of(options.local, places.descriptor.describer)  # wrong features are reported before the work
    _fill(places, inputs)
    asked = PlaceMap(places.descriptor, places.size)
    _add(asked, "queries", inputs.queries, inputs)
    reference, queries = places.described, asked.described
    known = known_places(reference, queries, options.places, places.tolerances, options.tolerance)
    with work_progress("looking up", "queries") as progress:
        found = places.match(
            queries.index,
            max(options.matches, candidates or 0),
            centring=options.centring,
            sequence=options.sequence,
            same=known.same_place,
            progress=progress,
        )
    remarked = []
    if candidates:
        before = found.neighbours.indices[:, 0]
        with work_progress("re-ranking", "queries") as progress:
            found = places.reranked(
                found, options.matches, candidates, queries.paths, progress, options.local, known.same_place
            )
        replaced = int((before != found.neighbours.indices[:, 0]).sum())
        remarked.append(
            f"rerank={candidates}: {replaced:,} of {len(before):,} best matches were replaced by one with "
            "significantly more inliers, and have no margin"
        )
        features = places.features(options.local)
        remarked.append(
            f"local features of {counted(len(features.kept), 'photo')} of the map: {features.bytes_per_photo:,} bytes "
            "a photo"
        )
        if options.keep:
            _save(places, inputs, "map")
    sure = places.found(found) if options.centring == "none" else None
    rows = query_rows(reference, queries, known, found, sure)
    tally = counts(rows)
    described = {"map": reference, "queries": queries}
    remarks = [*remarked, *_remarks(described, options, known, places.temperature, tally)]
    if CARD in run:
        remarks.insert(0, card_text(run[CARD]))
    if options.places != "none" and not options.given:
        remarks.append(f"compare with training-free descriptors: {_comparison(places, inputs, known, run)}")
    facts = {
        "run": run,
        "temperature": places.temperature.value,
        "matches": found.neighbours.indices.shape[1],
        "sequence": options.sequence,
        **({"rerank": candidates, "local": options.local} if candidates else {}),
        "centring": options.centring,
        "places": options.places,
        "tolerance": known.tolerance.name,
        "counts": tally,
        "remarks": remarks,
        **{key: photos.facts() for key, photos in described.items()},
    }
    write_matches(rows, facts, output)
    with work_progress("drawing", "pages") as progress:
        pages = write_gallery(rows, reference, queries, known, output, progress)
    kept = [path for path in (output / "map", output / "queries") if options.keep and path.is_dir()]
    if options.colmap:
        kept.append(write_row_pairs(rows, reference.photos.folder, queries.photos.folder, output))
    tell(rows, tally, described, remarks, [output / "matches.csv", output / "matches.json", *pages, *kept])
    return rows


def _fill(places: PlaceMap, inputs: PlaceInputs) -> None:
    """Describe the map's photos or load their descriptors; wrong options are reported before that."""
    if isinstance(inputs.reference, Path):
        try:
            places.take(inputs.reference)
        except UserError as error:
            raise UserError(
                f"map={inputs.reference}: {error.problem}",
                "Describe the map's photos again: map=<folder of photos> descriptors=true",
            ) from None
        refuse_overlap(places.described.photos, inputs.queries)
    reference = places.described.photos if isinstance(inputs.reference, Path) else inputs.reference
    check_truth(reference, inputs.queries, inputs.options.places)
    if inputs.options.colmap:
        check_pair_names(reference, inputs.queries)
    check_rides(len(reference), len(inputs.queries), inputs.options.sequence)
    if isinstance(inputs.reference, PhotoFolder):
        _add(places, "map", inputs.reference, inputs)


def _add(places: PlaceMap, key: str, photos: PhotoFolder, inputs: PlaceInputs) -> None:
    """Describe photos and save the descriptors at once, so that Ctrl-C loses little."""
    with work_progress(f"describing {'the map' if key == 'map' else key}", "photos") as progress:
        given = inputs.options.given.get(key)
        failed = places.add(photos, descriptors=given, errors="return", progress=progress)
    if not len(places):
        named = {
            Path(each.name).relative_to(photos.folder).as_posix(): each.error.problem.removeprefix(f"{each.name}: ")
            for each in failed
        }
        raise nothing_usable(f"{key}={photos.folder}: none of {counted(len(photos), 'photo')} can be used", named)
    if inputs.options.keep:
        _save(places, inputs, key)


def _save(places: PlaceMap, inputs: PlaceInputs, key: str) -> None:
    with telling_write_errors(inputs.output / key):
        places.save(inputs.output / key, descriptor=False)


def _remarks(
    described: Mapping[str, DescribedPhotos],
    options: PlaceOptions,
    places: KnownPlaces,
    temperature: Temperature,
    tally: Mapping[str, Any],
) -> list[str]:
    """Remarks for the reader of the results."""
    told = []
    if options.centring != "none":
        told.append(f"no confidence: the temperature was fitted without centring={options.centring}")
    elif temperature.value is None:
        told.append(f"no confidence, similarities only: {temperature.lacking}")
    else:
        told.append(f"{SUPPOSED} (temperature {temperature.value:.4g}, fitted on the run's validation split)")
        if options.sequence:
            told.append("matches by sequences have no confidence: the temperature was fitted to single photos")
    if options.places == "none" and places.tolerance.positive < 1:
        told.append(ALONE)
    for key, photos in described.items():
        if photos.stretched:
            told.append(
                f"{key}: {counted(len(photos.stretched), 'photo was', 'photos were')} stretched, such as "
                f"{photos.stretched[0]}, to the aspect ratio of the network's images, by a factor above "
                f"{LARGEST_STRETCH}"
            )
    if options.matches > len(described["map"].index):
        told.append(f"matches={options.matches}: the map has only {counted(len(described['map'].index), 'image')}")
    if tally["same_file"]:
        told.append(
            f"{counted(tally['same_file'], 'query is a copy of its', 'queries are copies of their')} best match, "
            "which does not test the network"
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


#: the meaning of a confidence, shown in the terminal and in matches.json
SUPPOSED = (
    "confidence is the probability that a match shows the query's place, assuming that this place is in the map: "
    "queries of other places get a confidence too"
)
ALONE = "each map image counts as a place of its own; if the map is a ride, give tolerance=<files> or places="


def tell(
    rows: Sequence[Mapping[str, Any]],
    tally: Mapping[str, Any],
    described: Mapping[str, DescribedPhotos],
    remarks: Sequence[str],
    written: Sequence[Path],
) -> None:
    """Print the matches, the photos that failed, remarks, and the paths of the files."""
    good = [row for row in rows if "error" not in row]
    console.print(rows_table("Best matches", [_line(row) for row in good[:NAMED]]))
    if len(good) > NAMED:
        console.print(f"[dim]and {len(good) - NAMED:,} more in matches.csv[/]")
    for key, photos in described.items():
        tell_skipped(photos.failed, f"Skipped of {key}")
    for remark in remarks:
        console.print(remark, style="dim", markup=False, soft_wrap=True)
    if "right" in tally:
        console.print(_truth(tally))
    done = (
        f"{counted(len(good), 'query', 'queries')} looked up among {counted(len(described['map'].index), 'map image')}"
    )
    tell_written(done, tally["failed"], written)


def _line(row: Mapping[str, Any]) -> dict[str, str]:
    best = row["matches"][0]
    line = {"query": row["query"], "match": best["match"], "similarity": f"{best['similarity']:.3f}"}
    if "inliers" in best:
        line["inliers"] = str(best["inliers"])
    if "verdict" in row:
        line["found"] = f"{row['found']:.2f}"
    line["margin"] = "–" if row["margin"] is None else f"{row['margin']:.3f}"
    if "confidence" in best:
        line["confidence"] = f"{best['confidence']:.2f}"
    if "right" in best:
        line["right"] = _verdict(row, best)
    if "sequence_matches" in row:
        line["by sequence"] = row["sequence_matches"][0]["match"]
        if "right" in best:
            line["right "] = _verdict(row, row["sequence_matches"][0])
    return line


def _verdict(row: Mapping[str, Any], match: Mapping[str, Any]) -> str:
    return "not in the map" if not row["in_map"] else "yes" if match["right"] else "no"


def _truth(tally: Mapping[str, Any]) -> str:
    inside, looked_up = tally["in_map"], tally["queries"] - tally["failed"]
    if not inside:
        return f"none of the {looked_up:,} queries has its place in the map, so no match can be right"
    told = (
        f"best match right: {tally['right']:,} of the {counted(inside, 'query', 'queries')} whose place is in the map"
    )
    if "mean_confidence_in_map" in tally:
        told += f" (mean confidence {tally['mean_confidence_in_map']:.2f})"
    if "right_by_sequence" in tally:
        told += f", by sequences {tally['right_by_sequence']:,}"
    return told + (f". {looked_up - inside:,} have no place in the map" if looked_up > inside else "")
