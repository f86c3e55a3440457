"""Reading photo headers: no pixels are decoded, so that thousands are read in seconds."""

import mmap
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from PIL import Image

from sextant.data.metadata import EXIF_BLOCK, as_text, directory, exif_of, tag_of, xmp_of
from sextant.data.photos.exif import GravityTag, exif_focal_px, exif_numbers, gravity_tag
from sextant.data.photos.gps import PhotoGps, gps_position
from sextant.data.picture_files import UnreadableImageError, open_picture, why_unreadable
from sextant.data.upright import upright_size

MAKE, MODEL, TAKEN, SUBSECONDS = 0x010F, 0x0110, 0x9003, 0x9291
END_OF_JPEG, SCAN, END_OF_PNG = b"\xff\xd9", b"\xff\xda", b"IEND"


@dataclass(frozen=True)
class PhotoHeader:
    """A photo as its header describes it.

    Attributes:
        path: of the file.
        bytes: size of the file.
        width, height: upright, pixels.
        camera: make and model from EXIF; "" if it has none.
        focal_px: focal length from EXIF, pixels.
        taken_s: when it was taken, from EXIF, seconds since 1970 on the camera's clock.
        gps: where it was taken, and what is doubtful or wrong with that, from EXIF or XMP.
        gravity: which metadata gives the vertical.
        tagged_panorama: whether its metadata mark it as a 360-degree panorama.
    """

    path: Path
    bytes: int
    width: int
    height: int
    camera: str
    focal_px: float | None
    taken_s: float | None
    gps: PhotoGps
    gravity: GravityTag | None
    tagged_panorama: bool


def read_header(path: Path) -> PhotoHeader:
    """Read the header of a photo; JPEG and PNG files are also checked for their end marker.

    Pillow's pixel limit should be lifted, see :func:`~sextant.data.photos.reading.without_pillow_limit`.

    Raises:
        UnreadableImageError: the file does not exist, is empty, is not a picture in a known format, or is truncated.
    """
    try:
        if not path.is_file():  # reading a pipe might never end
            raise FileNotFoundError
        size = path.stat().st_size
        with open_picture(path) as image:
            exif, xmp = exif_of(image), xmp_of(image)
            width, height = upright_size(image)
            header = PhotoHeader(
                path, size, width, height, _camera(exif), exif_focal_px(exif_numbers(image), width, height),
                _taken(exif), gps_position(exif, xmp), gravity_tag(exif, xmp), b"equirectangular" in xmp.lower(),
            )  # fmt: skip
            kind = image.format
        whole = _is_whole(path, kind or "", size)
    except Exception as error:  # Pillow raises errors of any kind for a damaged file
        raise UnreadableImageError(why_unreadable(path, error)) from None
    if not whole:
        raise UnreadableImageError(f"is truncated ({size:,} bytes): its end is missing")
    return header


def _camera(exif: Image.Exif) -> str:
    make, model = (" ".join(as_text(tag_of(exif, tag)).split()) for tag in (MAKE, MODEL))
    named = set(make.lower().split()) & set(model.lower().split())
    return model if named else f"{make} {model}".strip()


def _taken(exif: Image.Exif) -> float | None:
    block = directory(exif, EXIF_BLOCK)
    try:
        whole = datetime.strptime(as_text(block.get(TAKEN)), "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
    except ValueError:
        return None
    part = as_text(block.get(SUBSECONDS))
    return whole.timestamp() + (float(f"0.{part}") if part.isdecimal() and part.isascii() else 0.0)


def _is_whole(path: Path, kind: str, size: int) -> bool:
    """Whether a file has the end marker of its format; some programs write more after it."""
    if kind not in ("JPEG", "MPO", "PNG"):
        return True
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        if kind == "PNG":
            return content.rfind(END_OF_PNG) > 0
        if content[size - 2 :] == END_OF_JPEG:
            return True
        return content.find(END_OF_JPEG, _first_scan(content, size)) > 0


def _first_scan(content: mmap.mmap, size: int) -> int:
    """Offset of the compressed picture; the bytes before it may hold the end marker of a preview."""
    at = 2
    while at + 4 <= size and content[at : at + 2] != SCAN:
        at += 2 + int.from_bytes(content[at + 2 : at + 4], "big")
    return at
