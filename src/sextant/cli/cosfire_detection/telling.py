"""Terminal output of detections."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.markup import escape

from sextant.cli.console import console, rows_table
from sextant.cli.output_folder import tell_written
from sextant.cli.skipped_files import tell_skipped
from sextant.errors import NAMED


def tell(
    rows: Sequence[Mapping[str, Any]], skipped: Mapping[str, str], remarks: Sequence[str], written: Sequence[Path]
) -> None:
    """Print what was found, which images failed, remarks on the scores, and where the files are."""
    good = [row for row in rows if row["file"] not in skipped]
    ordered = sorted(good, key=_best, reverse=True)
    table = [
        {
            "image": Path(row["file"]).name,
            "found": f"{len(row['detections']):,}",
            "best score": f"{_best(row):.2f}" if row["detections"] else "–",
        }
        for row in ordered[:NAMED]
    ]
    console.print(rows_table("Detections", table))
    if len(ordered) > NAMED:
        console.print(f"[dim]and {len(ordered) - NAMED:,} more in detections.json[/]")
    tell_skipped(skipped)
    for remark in remarks:
        console.print(f"[dim]{escape(remark)}[/]")
    total = sum(len(row["detections"]) for row in good)
    tell_written(f"{total:,} detections in {len(good):,} images", len(skipped), written)


def _best(row: Mapping[str, Any]) -> float:
    return max((float(found["score"]) for found in row["detections"]), default=0.0)
