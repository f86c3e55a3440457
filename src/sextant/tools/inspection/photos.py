"""Cameras, duplicates and panoramas among many photos, mostly from their headers."""

import hashlib
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from sextant.atomic_files import file_sha256
from sextant.data.image_files import decode_image
from sextant.data.photos.header import PhotoHeader, read_header
from sextant.data.photos.odd_pictures import is_panorama
from sextant.data.photos.reading import SMALLEST_SIDE, without_pillow_limit
from sextant.data.picture_files import UnreadableImageError
from sextant.reporter import Advance

#: headers that are read at a time, since disks and networks are slow to answer
THREADS = 8
#: bytes that are compared first, before whole files
HEAD = 65536
#: rows at which panoramas are checked
PANORAMA_ROWS = 256
#: a panorama with fewer rows is of no use
SMALLEST_PANORAMA = 128


@dataclass(frozen=True)
class CameraGroup:
    """Photos of one camera and lens setting, as far as headers show.

    Attributes:
        camera: make and model; "" if EXIF names none.
        long, short: sides of the photos, pixels.
        focal_px: focal length from EXIF; None if it has none.
        photos: number of photos.
    """

    camera: str
    long: int
    short: int
    focal_px: float | None
    photos: int


def read_headers(
    folder: Path, files: Sequence[Path], advance: Advance
) -> tuple[dict[Path, PhotoHeader], dict[str, str]]:
    """Headers by file; and for files without one, the reason by name."""

    def read(file: Path) -> PhotoHeader | str:
        try:
            return read_header(folder / file)
        except UnreadableImageError as error:
            return str(error)

    headers: dict[Path, PhotoHeader] = {}
    unreadable: dict[str, str] = {}
    with without_pillow_limit(), ThreadPoolExecutor(THREADS) as pool:
        for done, (file, found) in enumerate(zip(files, pool.map(read, files), strict=True), start=1):
            if isinstance(found, str):
                unreadable[file.as_posix()] = found
            else:
                headers[file] = found
            advance(done, len(files))
    return headers, unreadable


def camera_groups(headers: Sequence[PhotoHeader]) -> list[CameraGroup]:
    """Cameras with their lens settings, the most frequent first; photos rotated by 90 degrees count as the same."""
    keys = Counter(
        (
            each.camera,
            max(each.width, each.height),
            min(each.width, each.height),
            None if each.focal_px is None else round(each.focal_px, 1),
        )
        for each in headers
    )
    return [CameraGroup(*key, photos) for key, photos in keys.most_common()]


def fit_for_calibration(headers: dict[Path, PhotoHeader], panoramas: Sequence[Path]) -> dict[Path, PhotoHeader]:
    """The photos that ``sextant predict`` calibrates."""
    around = set(panoramas)
    large = {file: each for file, each in headers.items() if min(each.width, each.height) >= SMALLEST_SIDE}
    return {file: each for file, each in large.items() if file not in around}


def described(groups: Sequence[CameraGroup]) -> str:
    """The number of cameras, or of image sizes where EXIF names no camera."""
    named = any(group.camera or group.focal_px for group in groups)
    return f"{len(groups):,} {'cameras or settings of a lens' if named else 'sizes'}"


def duplicates(headers: dict[Path, PhotoHeader], advance: Advance) -> list[tuple[str, ...]]:
    """Files of equal content. Only files of equal size are read, and only those with equal beginnings completely."""
    sizes = Counter(header.bytes for header in headers.values())
    asked = [(file, header) for file, header in headers.items() if sizes[header.bytes] > 1]
    begins: dict[tuple[int, bytes], list[Path]] = {}
    for done, (file, header) in enumerate(asked, start=1):
        with header.path.open("rb") as opened:
            begins.setdefault((header.bytes, hashlib.sha256(opened.read(HEAD)).digest()), []).append(file)
        advance(done, len(asked))
    groups: dict[str, list[str]] = {}
    for (size, begin), files in begins.items():
        for file in files if len(files) > 1 else ():
            digest = begin.hex() if size <= HEAD else file_sha256(headers[file].path)
            groups.setdefault(digest, []).append(file.as_posix())
    return [tuple(files) for files in groups.values() if len(files) > 1]


def panoramas(headers: dict[Path, PhotoHeader], advance: Advance) -> list[Path]:
    """Photos of 2:1 that metadata call panoramas, or whose sides join; only these are decoded, at a small size.

    If most photos of 2:1 in a folder are panoramas, all of them count as such: a bright sky hides the seam of some.
    """
    wide = {
        file: each
        for file, each in headers.items()
        if each.height >= SMALLEST_PANORAMA and abs(each.width / each.height - 2) <= 0.01
    }
    closed: dict[Path, bool] = {}
    for done, (file, header) in enumerate(wide.items(), start=1):
        closed[file] = header.tagged_panorama or _is_closed(header)
        advance(done, len(wide))
    balance = Counter[Path]()
    for file, is_closed in closed.items():
        balance[file.parent] += 1 if is_closed else -1
    return [file for file, is_closed in closed.items() if is_closed or balance[file.parent] > 0]


def _is_closed(header: PhotoHeader) -> bool:
    rows = min(header.height, PANORAMA_ROWS)
    try:
        return is_panorama(decode_image(header.path, rows, 2 * rows, 3))
    except UnreadableImageError:
        return False
