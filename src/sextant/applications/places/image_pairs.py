"""Pairs of images that may show the same place, for matching their features with COLMAP's ``matches_importer``."""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from sextant.applications.write_errors import telling_write_errors
from sextant.atomic_files import write_atomically
from sextant.errors import ArgumentError

PAIRS = "pairs.txt"


def write_row_pairs(rows: Sequence[Mapping[str, Any]], reference: Path, queries: Path, output: Path) -> Path:
    """Write ``pairs.txt``: each query with its matches, also those by sequences, named relative to a common folder.

    Args:
        rows: see :func:`~sextant.applications.places.rows.query_rows`.
        reference, queries: folders of the map's photos and of the queries.
        output: folder to write into.

    Raises:
        UserError: as for :func:`write_pairs`.
    """
    pairs = [
        (queries / row["query"], reference / found["match"])
        for row in rows
        for found in (*row.get("matches", ()), *row.get("sequence_matches", ()))
    ]
    write_pairs(pairs, output / PAIRS, os.path.commonpath([reference.absolute(), queries.absolute()]))
    return output / PAIRS


def write_pairs(
    pairs: Iterable[tuple[Path | str, Path | str]], path: Path | str, image_path: Path | str | None = None
) -> Path:
    """Write one pair per line, two names separated by a space; each pair once, and no image with itself.

    Args:
        pairs: pairs of files.
        path: the file to write, ``pairs.txt``.
        image_path: folder that names are relative to, as in COLMAP's database; the one around all files unless given.

    Returns:
        The folder that names are relative to.

    Raises:
        ArgumentError: there is no pair, or a name contains a space, which COLMAP takes for the end of the name.
        UserError: the disk is full, or the folder cannot be written to.

    Example:
        >>> write_pairs(places.pairs(20), "pairs.txt", "photos")  # doctest: +SKIP
    """
    whole = [tuple(Path(os.path.abspath(file)) for file in pair) for pair in pairs]
    if not whole:
        raise ArgumentError("pairs=[]: there is no pair", "Give at least one.")
    common = os.path.commonpath([file.parent for pair in whole for file in pair])
    around = Path(os.path.abspath(image_path or common))
    lines: dict[frozenset[Path], str] = {}
    for one, other in whole:
        if one != other:
            lines.setdefault(frozenset((one, other)), f"{_name(one, around)} {_name(other, around)}\n")
    path = Path(path).expanduser()
    with telling_write_errors(path.parent):
        write_atomically(path, lambda file: file.writelines(line.encode() for line in lines.values()))
    return around


def _name(file: Path, around: Path) -> str:
    name = Path(os.path.relpath(file, around)).as_posix()
    if name.startswith("../"):
        raise ArgumentError(f"image_path={around}: {file} does not lie below it", "Give the folder around all images.")
    if any(letter.isspace() for letter in name):
        raise ArgumentError(f"pairs: {name!r} has a space, where COLMAP takes a name to end", "Rename it.")
    return name
