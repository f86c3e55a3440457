"""Reading photo headers: no pixels are decoded, so that thousands are read in seconds."""

import mmap
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from PIL import Image

from sextant.data.image_files import UnreadableImageError, not_decoded
from sextant.data.photos.exif import EXIF_BLOCK, exif_focal_px, exif_numbers
from sextant.data.photos.gps import GpsPosition, gps_position
from sextant.data.photos.gravity_tags import GravityTag, gravity_tag
from sextant.data.photos.reading import known_formats
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
        gps: where it was taken, from EXIF.
        gravity: which metadata tells the vertical.
        tagged_panorama: whether its metadata call it a 360-degree panorama.
    """

    path: Path
    bytes: int
    width: int
    height: int
    camera: str
    focal_px: float | None
    taken_s: float | None
    gps: GpsPosition | None
    gravity: GravityTag | None
    tagged_panorama: bool


def read_header(path: Path) -> PhotoHeader:
    """Read the header of a photo; JPEG and PNG files are also checked for their end marker.

    Pillow's pixel limit should be lifted, see :func:`~sextant.data.photos.reading.without_pillow_limit`.

    Raises:
        UnreadableImageError: the file does not exist, is empty, is not a picture in a known format, or is truncated.
    """
    if not path.is_file():
        raise UnreadableImageError("is a link to nothing" if path.is_symlink() else "is no file")
    try:
        size = path.stat().st_size
        with Image.open(path, formats=known_formats()) as image:
            exif, xmp = image.getexif(), image.info.get("xmp", b"")
            xmp = xmp if isinstance(xmp, bytes) else str(xmp).encode()
            width, height = upright_size(image)
            header = PhotoHeader(
                path, size, width, height, _camera(exif), exif_focal_px(exif_numbers(image), width, height),
                _taken(exif), gps_position(exif), gravity_tag(exif, xmp), b"equirectangular" in xmp.lower(),
            )  # fmt: skip
            kind = image.format
        whole = _is_whole(path, kind or "", size)
    except Exception as error:  # Pillow raises whatever it comes across in a damaged file
        raise UnreadableImageError(_reason(path, error)) from None
    if not whole:
        raise UnreadableImageError(f"is truncated ({size:,} bytes): its end is missing")
    return header


def _reason(path: Path, error: Exception) -> str:
    if isinstance(error, OSError) and error.errno is not None:
        return f"cannot be read: {error.strerror}"
    size = path.stat().st_size
    if size == 0:
        return "is empty (0 bytes)"
    return not_decoded(path) or f"is no picture that can be read ({size:,} bytes)"


def _camera(exif: Image.Exif) -> str:
    make, model = (" ".join(str(exif.get(tag, "")).replace("\0", " ").split()) for tag in (MAKE, MODEL))
    named = set(make.lower().split()) & set(model.lower().split())
    return model if named else f"{make} {model}".strip()


def _taken(exif: Image.Exif) -> float | None:
    try:
        block: dict[int, Any] = dict(exif.get_ifd(EXIF_BLOCK))
        whole = datetime.strptime(str(block[TAKEN]).strip("\0 "), "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
        part = str(block.get(SUBSECONDS, "")).strip("\0 ")
        return whole.timestamp() + (float(f"0.{part}") if part.isdecimal() else 0.0)
    except Exception:  # metadata that cannot be read is no reason to refuse the photo
        return None


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
