"""The files for all queries together: a table, and a JSON file with everything."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from sextant.applications.write_errors import telling_write_errors
from sextant.atomic_files import write_csv, write_json

COLUMNS = ("query", "rank", "match", "similarity", "confidence", "margin", "right")
SEQUENCE_COLUMNS = ("sequence_match", "sequence_similarity", "sequence_right")


def write_matches(rows: Sequence[Mapping[str, Any]], facts: Mapping[str, Any], output: Path) -> None:
    """Write ``matches.csv``, a row per query and rank, and ``matches.json`` with ``facts``.

    Raises:
        UserError: the disk is full, or the folder cannot be written to.
    """
    with telling_write_errors(output):
        write_json(output / "matches.json", {**facts, "results": list(rows)})
        sequences = any("sequence_matches" in row for row in rows)
        columns = [*COLUMNS, *(SEQUENCE_COLUMNS if sequences else ()), "error"]
        write_csv(output / "matches.csv", columns, (flat for row in rows for flat in _flat(row)))


def _flat(row: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """A row for each rank; the margin is that of the first."""
    if "error" in row:
        yield {"query": row["query"], "error": row["error"]}
        return
    sequences = row.get("sequence_matches", [{}] * len(row["matches"]))
    for single, sequence in zip(row["matches"], sequences, strict=True):
        flat = {"query": row["query"], **single}
        flat |= {f"sequence_{key}": value for key, value in sequence.items() if key != "rank"}
        if single["rank"] == 1 and row["margin"] is not None:
            flat["margin"] = row["margin"]
        yield flat
