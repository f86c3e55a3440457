"""Terminal output of matched places."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.markup import escape

from sextant.applications.places.describing import DescribedPhotos
from sextant.cli.console import console, rows_table
from sextant.cli.output_folder import tell_written
from sextant.cli.skipped_files import tell_skipped
from sextant.errors import NAMED

#: the meaning of a confidence, shown in the terminal and in matches.json
SUPPOSED = (
    "confidence is the probability that the place of a match is the query's, supposing that its place is in the map: a "
    "query of another place has some too"
)
ALONE = "each map image counts as a place of its own; if the map is a ride, give tolerance=<files> or places="


def tell(
    rows: Sequence[Mapping[str, Any]],
    counted: Mapping[str, Any],
    described: Mapping[str, DescribedPhotos],
    remarks: Sequence[str],
    written: Sequence[Path],
) -> None:
    """Print the matches, which photos failed, remarks, and where the files are."""
    good = [row for row in rows if "error" not in row]
    console.print(rows_table("Best matches", [_line(row) for row in good[:NAMED]]))
    if len(good) > NAMED:
        console.print(f"[dim]and {len(good) - NAMED:,} more in matches.csv[/]")
    for key, photos in described.items():
        tell_skipped(photos.failed, f"Skipped of {key}")
    for remark in remarks:
        console.print(f"[dim]{escape(remark)}[/]", soft_wrap=True)
    if "right" in counted:
        console.print(_truth(counted))
    done = f"{len(good):,} queries looked up among {len(described['map'].index):,} map images"
    tell_written(done, counted["failed"], written)


def _line(row: Mapping[str, Any]) -> dict[str, str]:
    best = row["matches"][0]
    line = {"query": row["query"], "match": best["match"], "similarity": f"{best['similarity']:.3f}"}
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


def _truth(counted: Mapping[str, Any]) -> str:
    inside, looked_up = counted["in_map"], counted["queries"] - counted["failed"]
    if not inside:
        return f"none of the {looked_up:,} queries has its place in the map, so no match can be right"
    told = f"best match right: {counted['right']:,} of the {inside:,} queries whose place is in the map"
    if "mean_confidence_in_map" in counted:
        told += f" (mean confidence {counted['mean_confidence_in_map']:.2f})"
    if "right_by_sequence" in counted:
        told += f", by sequences {counted['right_by_sequence']:,}"
    return told + (f". {looked_up - inside:,} have no place in the map" if looked_up > inside else "")
