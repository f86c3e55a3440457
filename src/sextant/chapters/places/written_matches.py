"""Output of matching: tables, galleries, and pairs of images for reconstruction."""

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from sextant.applications.write_errors import telling_write_errors
from sextant.atomic_files import file_sha256, write_atomically, write_csv, write_json
from sextant.chapters.places.describing import DescribedPhotos, upright_size
from sextant.chapters.places.known_places import KnownPlaces
from sextant.chapters.places.match_confidence import verdict
from sextant.chapters.places.matching import Match, Matches
from sextant.chapters.places.photo_folder import PhotoFolder
from sextant.data.image_files import decode_image
from sextant.errors import ArgumentError
from sextant.reporter import Advance

if TYPE_CHECKING:
    from sextant.chapters.places.figures import Retrieved


DIGITS = 6
#: similarity above which a query and its match may be one file
ALIKE = 0.9999


def query_rows(
    reference: DescribedPhotos,
    queries: DescribedPhotos,
    places: KnownPlaces,
    matches: Matches,
    found: Float64[ndarray, "m"] | None = None,
) -> list[dict[str, Any]]:
    """One row per query, in the order of the names, including queries that failed.

    Matches are listed best first. ``right`` and ``in_map`` are present where the ground truth is known; a query whose
    place is not in the map has no right match. With the probabilities ``found`` that the best matches show the places,
    rows have these and the verdicts.
    """
    numbers = iter(range(len(queries.index)))
    rows: list[dict[str, Any]] = []
    for name in queries.photos.names:
        if name in queries.failed:
            rows.append({"query": name, "error": queries.failed[name]})
            continue
        i = next(numbers)
        single, sequenced, margin = matches.single(i), matches.by_sequence(i), matches.margin_of(i)
        right = None if places.positives is None else set(places.positives[i].tolist())
        row: dict[str, Any] = {"query": name, "margin": None if margin is None else round(margin, DIGITS)}
        if found is not None and found[i] == found[i]:
            row |= {"found": round(float(found[i]), DIGITS), "verdict": verdict(float(found[i]))}
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
    for rank, (image, similarity, confidence, inliers) in enumerate(matches, 1):
        row = {"rank": rank, "match": names[image], "similarity": round(similarity, DIGITS)}
        if inliers is not None:
            row["inliers"] = inliers
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
    """Number of queries, of those that failed or are copies of their match and, with ground truth, of right ones."""
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


QUERIES, ON_A_PAGE = 40, 8
MATCHES = 5
LONGEST_SIDE = 200  # pixels
TITLE = 26  # characters of a name
#: names of the pages; other files with the same prefix are kept
PAGE = re.compile(r"matches_page\d+\.png")


def write_gallery(
    rows: Sequence[Mapping[str, Any]],
    reference: DescribedPhotos,
    queries: DescribedPhotos,
    places: KnownPlaces,
    output: Path,
    progress: Advance,
) -> list[Path]:
    """Write ``matches_page1.png``, ...: up to 40 evenly spaced queries, each with five matches.

    Matches are those by sequences, if there are any. Higher-numbered pages of an earlier run are deleted.

    Raises:
        UserError: the disk is full, or the folder cannot be written to.
    """
    from sextant.chapters.places.figures import retrieval_gallery
    from sextant.figures.style import save_figure

    good = [row for row in rows if "error" not in row]
    chosen = np.unique(np.linspace(0, len(good) - 1, min(QUERIES, len(good))).round().astype(int)).tolist()
    pages = [chosen[start : start + ON_A_PAGE] for start in range(0, len(chosen), ON_A_PAGE)]
    paths: list[Path] = []
    for number, page in enumerate(pages, 1):
        shown = [_retrieved(good[i], i, reference, queries, places) for i in page]
        by = "by sequences" if "sequence_matches" in good[0] else "by single photos"
        figure = retrieval_gallery(shown, f"page {number} of {len(pages)}: {len(chosen)} of {len(good)} queries, {by}")
        with telling_write_errors(output):
            paths += save_figure(figure, output, f"matches_page{number}")
        progress(number, len(pages))
    with telling_write_errors(output):
        for old in set(output.glob("matches_page*.png")) - set(paths):
            if PAGE.fullmatch(old.name):
                old.unlink()
    return paths


def _retrieved(
    row: Mapping[str, Any], number: int, reference: DescribedPhotos, queries: DescribedPhotos, places: KnownPlaces
) -> "Retrieved":
    from sextant.chapters.places.figures import Retrieved

    matches = row.get("sequence_matches", row["matches"])[:MATCHES]
    truth = None
    if places.positives is not None and row["in_map"]:
        own = places.positives[number]
        truth = picture(reference.photos.folder / reference.names[own[len(own) // 2]])
    return Retrieved(
        picture(queries.photos.folder / row["query"]),
        [picture(reference.photos.folder / each["match"]) for each in matches],
        [each.get("right") for each in matches],
        title=_short(row["query"]),
        titles=[f"{_short(each['match'])}\n{_numbers(each)}" for each in matches],
        truth=truth,
    )


def _numbers(each: Mapping[str, Any]) -> str:
    confidence = f", p = {each['confidence']:.2f}" if "confidence" in each else ""
    return f"{each['similarity']:.2f}{confidence}"


def _short(name: str) -> str:
    short = name if len(name) <= TITLE else f"…{name[1 - TITLE :]}"
    return short.replace("$", r"\$")  # Matplotlib sets text between two dollar signs as mathematics


def picture(path: Path) -> UInt8[ndarray, "h w 3"]:
    """A thumbnail of a photo; grey if the file cannot be read, as when it was deleted since it was added."""
    try:
        width, height = upright_size(path)
        scale = LONGEST_SIDE / max(width, height)
        return decode_image(path, max(1, round(scale * height)), max(1, round(scale * width)), 3)
    except Exception:  # only an illustration: the matches are valid without the file
        return np.full((LONGEST_SIDE * 2 // 3, LONGEST_SIDE, 3), 200, np.uint8)


PAIRS = "pairs.txt"


def write_row_pairs(rows: Sequence[Mapping[str, Any]], reference: Path, queries: Path, output: Path) -> Path:
    """Write ``pairs.txt``: each query with its matches, also those by sequences, named relative to a common folder.

    Args:
        rows: see :func:`~sextant.chapters.places.written_matches.query_rows`.
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
    write_pairs(pairs, output / PAIRS, _around_both(reference, queries))
    return output / PAIRS


def check_pair_names(reference: PhotoFolder, queries: PhotoFolder) -> None:
    """Raise an ``ArgumentError`` if a photo has a name that :func:`write_row_pairs` could not write."""
    around = Path(os.path.abspath(_around_both(reference.folder, queries.folder)))
    for path in (*reference.paths, *queries.paths):
        _name(Path(os.path.abspath(path)), around)


def _around_both(reference: Path, queries: Path) -> str:
    return os.path.commonpath([reference.absolute(), queries.absolute()])


def write_pairs(
    pairs: Iterable[tuple[Path | str, Path | str]], path: Path | str, image_path: Path | str | None = None
) -> Path:
    """Write one pair per line, two names separated by a space; each pair once, and no image with itself.

    Args:
        pairs: pairs of files.
        path: the file to write, ``pairs.txt``.
        image_path: folder that names are relative to, as in COLMAP's database; by default the folder around all files.

    Returns:
        The folder that names are relative to.

    Raises:
        ArgumentError: there is no pair, or a name contains a space, which COLMAP treats as the end of the name.
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
        raise ArgumentError(f"image_path={around}: {file} does not lie below it", "Give a folder around all images.")
    if any(letter.isspace() for letter in name):
        raise ArgumentError(f"pairs: {name!r} has a space, which COLMAP treats as the end of a name", "Rename it.")
    return name


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
        counted = any("inliers" in match for row in rows for match in row.get("matches", ()))
        told = any("verdict" in row for row in rows)
        columns = [*COLUMNS, *(("inliers",) if counted else ()), *(("found", "verdict") if told else ())]
        columns += [*(SEQUENCE_COLUMNS if sequences else ()), "error"]
        write_csv(output / "matches.csv", columns, (flat for row in rows for flat in _flat(row)))


def _flat(row: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """A row for each rank; the margin is that of the first, as are probability and verdict."""
    if "error" in row:
        yield {"query": row["query"], "error": row["error"]}
        return
    sequences = row.get("sequence_matches", [{}] * len(row["matches"]))
    for single, sequence in zip(row["matches"], sequences, strict=True):
        flat = {"query": row["query"], **single}
        flat |= {f"sequence_{key}": value for key, value in sequence.items() if key != "rank"}
        if single["rank"] == 1 and row["margin"] is not None:
            flat["margin"] = row["margin"]
        if single["rank"] == 1 and "verdict" in row:
            flat |= {key: row[key] for key in ("found", "verdict")}
        yield flat
