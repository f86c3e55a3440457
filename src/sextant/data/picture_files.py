"""Open picture files of any kind by their content, and explain why others cannot be opened."""

import io
import mmap
import zlib
from pathlib import Path

from PIL import Image, UnidentifiedImageError

from sextant.data.file_kinds import first_bytes, is_text, not_decoded, unfit_tiff

#: formats that are decoded; none whose decoder runs another program, as that of EPS does
FORMATS = ("JPEG", "MPO", "PNG", "TIFF", "BMP", "WEBP", "PPM", "GIF", "JPEG2000", "AVIF")
PNG = b"\x89PNG\r\n\x1a\n"
#: kinds of PNG chunks that hold text or a colour profile, and the bytes, uncompressed, up to which they are read
SPOKEN, LARGEST_SPOKEN = (b"tEXt", b"zTXt", b"iTXt", b"iCCP"), 2**20


#: bytes without which Pillow fails on a chunk
SHORTEST = {b"gAMA": 4, b"cHRM": 32, b"sRGB": 1, b"pHYs": 9}
#: what to do with the content of a picture file
DECODE = "Decode the content of a file first: PIL.Image.open(io.BytesIO(data))."


class UnreadableImageError(OSError):
    """The file cannot be decoded; the message says why, without the file's name."""


def open_picture(path: Path) -> Image.Image:
    """Open a picture of any name without decoding it; the caller closes it.

    Raises:
        UnreadableImageError: it is the preview in a raw file, a TIFF that Pillow opens but reads wrongly, or has more
            pixels than Pillow decodes.
        OSError: or any other error of Pillow for a file that is not a picture; :func:`why_unreadable` gives the reason.
    """
    Image.init()  # until then Pillow supports only the commonest formats
    content = None if first_bytes(path, 8) != PNG else _without_odd_chunks(path)
    try:
        image = Image.open(path if content is None else io.BytesIO(content), formats=known_formats())
    except Image.DecompressionBombError:
        most = 2 * (Image.MAX_IMAGE_PIXELS or 0) / 1e6
        raise UnreadableImageError(f"has more than {most:.0f} megapixels; scale it down") from None
    if reason := unfit_tiff(image, path.suffix.lower()):
        image.close()
        raise UnreadableImageError(reason)
    return image


def known_formats() -> list[str]:
    """Those of :data:`FORMATS` that the installed Pillow reads."""
    Image.init()
    return [name for name in FORMATS if name in Image.OPEN]


def why_unreadable(path: Path, error: Exception) -> str:
    """Why a picture cannot be read, on one line without the file's name, after ``error`` was raised for it."""
    if isinstance(error, UnreadableImageError):
        return str(error)
    if not path.is_file():
        return "is a broken link" if path.is_symlink() else "is not a file" if path.exists() else "does not exist"
    if isinstance(error, OSError) and error.errno is not None:
        return f"cannot be read: {error.strerror}"
    size = path.stat().st_size
    if size == 0:
        return "is empty (0 bytes)"
    why = next(iter(str(error).splitlines()), type(error).__name__)
    if isinstance(error, UnidentifiedImageError):
        if kind := not_decoded(path):
            return kind
        why = "it is text" if is_text(path) else "it is not a picture in a known format"
    return f"cannot be decoded ({size:,} bytes): {why}"


def _without_odd_chunks(path: Path) -> bytes | None:
    """A PNG file without the chunks that hold no pixels and are large or damaged; None if there are none.

    Pillow refuses a whole picture for the sake of such a chunk.
    """
    kept, at, left_out = [slice(len(PNG))], len(PNG), False
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        while at + 12 <= len(content):
            length, kind = int.from_bytes(content[at : at + 4], "big"), content[at + 4 : at + 8]
            end = at + 12 + length
            if kind[:1].islower() and _is_odd(kind, content[at + 8 : end - 4], content[end - 4 : end]):
                left_out = True
            else:
                kept.append(slice(at, end))
            at = end
        return b"".join(content[part] for part in kept) if left_out else None


def _is_odd(kind: bytes, data: bytes, check: bytes) -> bool:
    if zlib.crc32(kind + data) != int.from_bytes(check, "big") or len(data) < SHORTEST.get(kind, 0):
        return True
    if kind not in SPOKEN:
        return False
    _, _, packed = data.partition(b"\0")  # a keyword; then the method, or for iTXt whether it is packed at all
    if len(data) > LARGEST_SPOKEN or (kind == b"iCCP" and packed[:1] != b"\0"):
        return True
    packed = packed[2:].split(b"\0", 2)[-1] if kind == b"iTXt" and packed[:1] == b"\1" else packed[1:]
    unpacking = zlib.decompressobj()
    try:
        unpacking.decompress(packed, LARGEST_SPOKEN)
    except zlib.error:  # Pillow passes over it, or it is not packed
        return False
    return bool(unpacking.unconsumed_tail)
