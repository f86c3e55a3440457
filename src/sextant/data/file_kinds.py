"""Identify files that are given as pictures but are none, and names that are hidden or system files."""

import mimetypes
import re
from pathlib import Path

from PIL import Image

#: raw sensor data
RAW = (
    ".dng", ".cr2", ".cr3", ".crw", ".nef", ".nrw", ".arw", ".srf", ".sr2", ".srw", ".raf", ".orf", ".rw2", ".rwl",
    ".raw", ".pef", ".ptx", ".x3f", ".mrw", ".dcr", ".kdc", ".erf", ".mef", ".mos", ".3fr", ".fff", ".iiq", ".gpr",
)  # fmt: skip
HEIC = (".heic", ".heif", ".hif")
NAMELESS, RENAME = ", by its content a photo, whose name has no suffix", "add .jpg or another suffix"
DEVELOP = "develop it to JPEG, or to PNG or TIFF of 16 bits, with darktable, RawTherapee or dcraw"
RAW_FILE = "is a raw file{}, which is not decoded here: " + DEVELOP
VIDEO = "is a video, not a photo: sextant predict calibrates one that ends in .mp4, .mov or .avi; or save its frames"
TIFF = "is a TIFF of a kind that is not read here: save it with 8 or 16 bits per channel"
PLANES = "is a 16-bit TIFF with a plane for each colour, which is not read here: save it interleaved, or as PNG"
NOT_HEIC = "is {}, which is not decoded here: save it as JPEG"
#: beginnings of files, as patterns, and what such a file is
BEGINNINGS = {
    rb"....ftypavi": "",  # decoded if this Pillow does; other brands follow
    rb"....ftyp(hei|hev|mif1|msf1)": NOT_HEIC.format("HEIC by its content"),
    rb"....ftypcrx": RAW_FILE.format(" by its content (CR3)"),
    rb"....(ftyp|moov|mdat|wide)|RIFF....AVI |\x1aE\xdf\xa3|FLV\x01|\0\0\x01[\xb3\xba]": VIDEO,
    rb"FUJIFILMCCD-RAW|II\*\0....CR|II(RO|RS|U\0)|MMOR|II\x1a\0...\0HEAPCCDR|\0MRM|FOVb": RAW_FILE.format(
        " by its content"
    ),
    rb"%PDF-": "is a PDF document, not a picture: export its pages as PNG",
    rb"8BPS": "is a Photoshop document, which is not decoded here: export it as PNG or TIFF",
    rb"\xff\x0a|\0\0\0\x0cJXL ": "is JPEG XL, which is not decoded here: save it as JPEG or PNG",
    rb"v/1\x01|#\?RADIANCE|#\?RGBE": "is a picture of high dynamic range, whose white level is unknown: save it as PNG",
    rb"PK\x03\x04|PK\x05\x06|\x1f\x8b|7z\xbc\xaf|Rar!|BZh|\xfd7zXZ": "is an archive, not a picture: unpack it",
    rb"\x93NUMPY|SIMPLE  =|\x89HDF": "is a file of arrays, not a picture: save them as PNG",
    rb"version https://git-lfs": "is a pointer of Git LFS, not the picture itself: git lfs pull",
    rb"%!PS": "is PostScript, which is not run here: save it as PNG",
    rb"\s*(<\?xml.*)?(<!--.*)?\s*<svg": "is an SVG drawing, not a photo: export it as PNG",
    rb"\s*(<!doctype html|<html|<head)": "is an HTML page, not a picture, as left by a failed download: load it again",
    rb"\s*<\?xml": "is XML, not a picture",
    rb"\0{512}": "holds zeros, as left by an incomplete copy: copy it again",
}
SUBFILE, OLD_SUBFILE, BITS_PER_SAMPLE, PLANAR, DNG_VERSION = 0x00FE, 0x00FF, 0x0102, 0x011C, 0xC612
#: what systems and network drives leave among photos, besides names that begin with a dot; in lower case
SYSTEM = re.compile(
    r"__macosx.*|@eadir|@tmp|@recycle|@recently-snapshot|#recycle|#snapshot|\$recycle\.bin|recycler|lost\+found"
    r"|system volume information|network trash folder|temporary items|synofile_thumb.*|(eh)?thumbs\.db|desktop\.ini"
)


def is_hidden(name: str) -> bool:
    """Whether a file or folder of this name is hidden, or a system's own: a thumbnail, resource fork or wastebasket.

    Example:
        >>> [is_hidden(name) for name in ("._1.jpg", "@eaDir", "Thumbs.db", "IMG_1.jpg")]
        [True, True, True, False]
    """
    return name.startswith(".") or SYSTEM.fullmatch(name.lower()) is not None


def not_decoded(path: Path) -> str | None:
    """Why a file is not read as a picture, judged by its content, else by its name; None if no reason is found."""
    suffix = path.suffix.lower()
    head = first_bytes(path, 512)
    known = (kind for pattern, kind in BEGINNINGS.items() if re.match(pattern, head, re.DOTALL | re.IGNORECASE))
    if (kind := next(known, None)) is not None:
        return kind or None
    if suffix in (*RAW, *HEIC):
        return RAW_FILE.format(f" ({suffix})") if suffix in RAW else NOT_HEIC.format(suffix)
    if (mimetypes.guess_type(path.name)[0] or "").startswith("video/"):
        return VIDEO
    return TIFF if head.startswith((b"II*\0", b"MM\0*")) else None


def is_nameless_picture(path: Path) -> bool:
    """Whether a file without suffix begins like a JPEG, PNG or WebP."""
    return (
        not path.suffix
        and re.match(rb"\xff\xd8\xff|\x89PNG|RIFF....WEBP", first_bytes(path, 12), re.DOTALL) is not None
    )


def is_text(path: Path) -> bool:
    """Whether a file begins like one of text."""
    head = first_bytes(path, 512)
    return bool(head) and not re.search(rb"[^\t-\r\x1b -~\x80-\xff]", head)


def first_bytes(path: Path, count: int) -> bytes:
    """The beginning of a file; empty if it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(count)
    except OSError:
        return b""


def unfit_tiff(image: Image.Image, suffix: str) -> str | None:
    """Why an open picture is not read although Pillow would; None if it is read.

    The first directory of a TIFF states in NewSubfileType whether its picture is a smaller version of another one (TIFF
    6.0, section 8); a raw file begins with such a preview. The libraries used here decode 16-bit planes wrongly.
    """
    if image.format != "TIFF":
        return None
    tags = getattr(image, "tag_v2", {})
    if suffix in RAW or DNG_VERSION in tags:
        return RAW_FILE.format(f" ({suffix})" if suffix in RAW else " (DNG by its tags)")
    if tags.get(SUBFILE) in (1, 3, 5, 7) or tags.get(OLD_SUBFILE) == 2:
        return RAW_FILE.format(" by its tags (the first picture is a smaller version of another, NewSubfileType 1)")
    bits = tags.get(BITS_PER_SAMPLE, ())
    return PLANES if tags.get(PLANAR) == 2 and len(bits) > 1 and max(bits) > 8 else None
