"""All that is told of each query, as plain values."""

from collections.abc import Mapping, Sequence
from typing import Any

from jaxtyping import Float, Int64
from numpy import ndarray

from sextant.applications.places.describing import DescribedPhotos
from sextant.applications.places.known_places import KnownPlaces
from sextant.applications.places.matching import Matches
from sextant.data.source import file_sha256

DIGITS = 6
#: similarity above which a query and its match may be one file
ALIKE = 0.9999


def query_rows(
    reference: DescribedPhotos, queries: DescribedPhotos, places: KnownPlaces, matches: Matches
) -> list[dict[str, Any]]:
    """One row a query in the order of the names, those included that failed.

    ``matches`` are the best first. ``right`` and ``in_map`` are there where the truth is known; a query whose place is
    not in the map has no right match.
    """
    best, sequences = matches.neighbours, matches.sequences
    found = iter(range(len(queries.index)))
    rows: list[dict[str, Any]] = []
    for name in queries.photos.names:
        if name in queries.failed:
            rows.append({"query": name, "error": queries.failed[name]})
            continue
        i = next(found)
        margin = float(matches.margin[i])
        row: dict[str, Any] = {"query": name, "margin": None if margin != margin else round(margin, DIGITS)}
        confidence = None if matches.confidence is None else matches.confidence[i]
        row["matches"] = _listed(
            reference, best.indices[i], best.values[i], confidence, _right(places, i, best.indices)
        )
        if sequences is not None:
            right = _right(places, i, sequences.indices)
            row["sequence_matches"] = _listed(reference, sequences.indices[i], sequences.scores[i], None, right)
        if places.positives is not None:
            row["in_map"] = bool(places.positives.matchable[i])
        if best.values[i, 0] > ALIKE and _same_file(reference, queries, name, row["matches"][0]["match"]):
            row["same_file"] = True
        rows.append(row)
    return rows


def _right(places: KnownPlaces, query: int, indices: Int64[ndarray, "m k"]) -> list[bool] | None:
    if places.positives is None:
        return None
    own = set(places.positives[query].tolist())
    return [int(j) in own for j in indices[query]]


def _listed(
    reference: DescribedPhotos,
    indices: Int64[ndarray, "k"],
    values: Float[ndarray, "k"],
    confidence: Float[ndarray, "k"] | None,
    right: Sequence[bool] | None,
) -> list[dict[str, Any]]:
    names = reference.index.names or ()
    listed = []
    for rank, (j, value) in enumerate(zip(indices, values, strict=True)):
        row = {"rank": rank + 1, "match": names[j], "similarity": round(float(value), DIGITS)}
        if confidence is not None:
            row["confidence"] = round(float(confidence[rank]), DIGITS)
        if right is not None:
            row["right"] = bool(right[rank])
        listed.append(row)
    return listed


def _same_file(reference: DescribedPhotos, queries: DescribedPhotos, query: str, match: str) -> bool:
    paths = queries.photos.folder / query, reference.photos.folder / match
    return all(path.is_file() for path in paths) and file_sha256(paths[0]) == file_sha256(paths[1])


def counts(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """How many queries were looked up, failed, are copies of their match, and, where it is known, are right."""
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
