"""Everything that is reported of each query, as plain values."""

from collections.abc import Mapping, Sequence, Set
from typing import Any

from sextant.applications.places.describing import DescribedPhotos
from sextant.applications.places.known_places import KnownPlaces
from sextant.applications.places.matching import Match, Matches
from sextant.data.source import file_sha256

DIGITS = 6
#: similarity above which a query and its match may be one file
ALIKE = 0.9999


def query_rows(
    reference: DescribedPhotos, queries: DescribedPhotos, places: KnownPlaces, matches: Matches
) -> list[dict[str, Any]]:
    """One row per query, in the order of the names, including queries that failed.

    Matches are listed best first. ``right`` and ``in_map`` are present where the ground truth is known; a query whose
    place is not in the map has no right match.
    """
    found = iter(range(len(queries.index)))
    rows: list[dict[str, Any]] = []
    for name in queries.photos.names:
        if name in queries.failed:
            rows.append({"query": name, "error": queries.failed[name]})
            continue
        i = next(found)
        single, sequenced, margin = matches.single(i), matches.by_sequence(i), matches.margin_of(i)
        right = None if places.positives is None else set(places.positives[i].tolist())
        row: dict[str, Any] = {"query": name, "margin": None if margin is None else round(margin, DIGITS)}
        row["matches"] = _listed(reference, single, right)
        if sequenced is not None:
            row["sequence_matches"] = _listed(reference, sequenced, right)
        if places.positives is not None:
            row["in_map"] = bool(places.positives.matchable[i])
        if single[0].similarity > ALIKE and _same_file(reference, queries, name, row["matches"][0]["match"]):
            row["same_file"] = True
        rows.append(row)
    return rows


def _listed(reference: DescribedPhotos, matches: Sequence[Match], right: Set[int] | None) -> list[dict[str, Any]]:
    names = reference.index.names or ()
    listed = []
    for rank, (image, similarity, confidence) in enumerate(matches, 1):
        row = {"rank": rank, "match": names[image], "similarity": round(similarity, DIGITS)}
        if confidence is not None:
            row["confidence"] = round(confidence, DIGITS)
        if right is not None:
            row["right"] = image in right
        listed.append(row)
    return listed


def _same_file(reference: DescribedPhotos, queries: DescribedPhotos, query: str, match: str) -> bool:
    paths = queries.photos.folder / query, reference.photos.folder / match
    return all(path.is_file() for path in paths) and file_sha256(paths[0]) == file_sha256(paths[1])


def counts(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """How many queries were looked up, failed, are copies of their match and, where that is known, are right."""
    good = [row for row in rows if "error" not in row]
    told: dict[str, Any] = {
        "queries": len(rows),
        "failed": len(rows) - len(good),
        "same_file": sum(row.get("same_file", False) for row in good),
    }
    if good and "in_map" in good[0]:
        inside = [row for row in good if row["in_map"]]
        told |= {"in_map": len(inside), "right": sum(row["matches"][0]["right"] for row in inside)}
        if "sequence_matches" in good[0]:
            told["right_by_sequence"] = sum(row["sequence_matches"][0]["right"] for row in inside)
        if inside and "confidence" in inside[0]["matches"][0]:
            told["mean_confidence_in_map"] = sum(row["matches"][0]["confidence"] for row in inside) / len(inside)
    return told
