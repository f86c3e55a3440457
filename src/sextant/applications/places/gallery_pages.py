"""Pages of queries with their matches."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from sextant.applications.places.describing import DescribedPhotos, upright_size
from sextant.applications.places.known_places import KnownPlaces
from sextant.applications.write_errors import telling_write_errors
from sextant.data.image_files import decode_image
from sextant.reporter import Advance

if TYPE_CHECKING:
    from sextant.figures.places import Retrieved

QUERIES, ON_A_PAGE = 40, 8
MATCHES = 5
LONGEST_SIDE = 200  # pixels
TITLE = 26  # characters of a name
#: names of the pages; other files that begin alike are not ours
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
    from sextant.figures.places import retrieval_gallery
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
    from sextant.figures.places import Retrieved

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
    return short.replace("$", r"\$")  # Matplotlib takes what stands between two of them for mathematics


def picture(path: Path) -> UInt8[ndarray, "h w 3"]:
    """A small copy of a photo; grey if the file no longer exists, as for a map that is used again."""
    try:
        width, height = upright_size(path)
        scale = LONGEST_SIDE / max(width, height)
        return decode_image(path, max(1, round(scale * height)), max(1, round(scale * width)), 3)
    except Exception:  # only an illustration: whatever became of the file, the matches stand
        return np.full((LONGEST_SIDE * 2 // 3, LONGEST_SIDE, 3), 200, np.uint8)
