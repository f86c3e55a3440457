"""The files for all images together: a table of detections, and a JSON file with everything."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sextant.applications.write_errors import telling_write_errors
from sextant.atomic_files import write_csv, write_json
from sextant.chapters.cosfire.detector import ExampleDetector

COLUMNS = ("file", "x", "y", "score")
MOVE_COLUMNS = ("rotation_deg", "scale", "mirrored")


def write_detections(rows: Sequence[Mapping[str, Any]], facts: Mapping[str, Any], output: Path) -> None:
    """Write ``detections.csv``, a row per detection or unreadable image, and ``detections.json``.

    Args:
        rows: one per image: its file, size and detections, or its error.
        facts: facts of the filter, for ``detections.json``.
        output: folder to write into.

    Raises:
        UserError: the disk is full, or the folder cannot be written to.
    """
    with telling_write_errors(output):
        write_json(output / "detections.json", {**facts, "images": list(rows)})
        lines = list(_lines(rows))
        moves = MOVE_COLUMNS if any("scale" in line for line in lines) else ()
        write_csv(output / "detections.csv", [*COLUMNS, *moves, "error"], lines)


def filter_facts(detector: ExampleDetector, source: Mapping[str, Any]) -> dict[str, Any]:
    """The filter of a detector with one example, as plain values.

    Args:
        detector: detector with its example.
        source: what the filter operates on: a preset, or a run and its layer.
    """
    (example,) = detector.examples
    scale = example.image.scale
    return {
        **source,
        "x": round((example.point[0] + 0.5) / scale - 0.5, 2),
        "y": round((example.point[1] + 0.5) / scale - 0.5, 2),
        "parts": example.parts,
        "own_response": example.own,
        "tolerance": asdict(detector.filters.tolerance),
        "prototype_scale": scale,
    }


def _lines(rows: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    for row in rows:
        if "error" in row:
            yield {"file": row["file"], "error": row["error"]}
        for found in row.get("detections", ()):
            yield {"file": row["file"], **found}
