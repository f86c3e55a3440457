"""What the terminal shows of detections."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.markup import escape

from sextant.cli.console import console, rows_table
from sextant.cli.skipped_files import skipped_table
from sextant.data.places.problem_list import NAMED


def tell(rows: Sequence[Mapping[str, Any]], remarks: Sequence[str], written: Sequence[Path]) -> None:
    """Print what was found, which images failed, what is to be known of the scores, and where the files are."""
    good = [row for row in rows if "error" not in row]
    ordered = sorted(good, key=_best, reverse=True)
    if ordered:
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
    failed = {row["file"]: row["error"] for row in rows if "error" in row}
    if failed:
        console.print(skipped_table(failed))
    for remark in remarks:
        console.print(f"[dim]{escape(remark)}[/]")
    total = sum(len(row["detections"]) for row in good)
    console.print(
        f"{total:,} detections in {len(good):,} images" + (f", [red]{len(failed):,} failed[/]" * bool(failed))
    )
    console.print(escape("\n".join(map(str, written))))


def _best(row: Mapping[str, Any]) -> float:
    return max((float(found["score"]) for found in row["detections"]), default=0.0)
