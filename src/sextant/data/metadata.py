"""EXIF metadata of pictures. Each tag is read separately, whatever its type, so that a malformed one affects no other.

Source: Exif 3.0 (CIPA DC-008), section 4.6. Text and numbers are taken from any type that holds them, as ExifTool does.
"""

import math
import re
from typing import Any

from PIL import Image
from PIL.TiffImagePlugin import ImageFileDirectory_v2

EXIF_BLOCK, GPS_BLOCK = 0x8769, 0x8825
NUMBER = re.compile(r"([+-]?(?:\d+(?:[.,]\d*)?|\.\d+)(?:[eE][+-]?\d+)?)(?:\s*/\s*(\d+(?:\.\d+)?))?")


def exif_of(image: Image.Image) -> Image.Exif:
    """The metadata of an open picture; empty if they are broken."""
    if image.format == "PNG" and "exif" not in image.info:
        image.load()  # they may follow the pixels; errors of these are not to be caught below
    try:
        return image.getexif()
    except Exception:  # Pillow raises errors of any kind; broken metadata are no reason to refuse a picture
        return Image.Exif()


def tag_of(exif: Image.Exif, tag: int) -> Any:
    """A tag of the main directory; None if it is missing or broken."""
    try:
        return exif.get(tag)
    except Exception:
        return None


def directory(exif: Image.Exif, tag: int) -> dict[int, Any]:
    """The directory that a tag points to, without those of its tags that are broken."""
    try:
        return dict(exif.get_ifd(tag))
    except Exception:
        pass
    found: dict[int, Any] = {}
    try:
        block = ImageFileDirectory_v2(exif.head)
        exif.fp.seek(int(as_number(tag_of(exif, tag)) or 0))
        block.load(exif.fp)
        for each in block:
            try:
                value = block[each]
            except Exception:
                continue
            found[each] = value[0] if isinstance(value, tuple) and len(value) == 1 else value
    except Exception:
        return found
    return found


def xmp_of(image: Image.Image) -> bytes:
    """The XMP packet of an open picture; empty if there is none."""
    xmp = image.info.get("xmp", b"")
    return xmp if isinstance(xmp, bytes) else str(xmp).encode()


def as_text(value: Any) -> str:
    """The text of a value of any type, without padding; "" for None.

    Example:
        >>> as_text(b"S\\x00"), as_text((83, 0)), as_text("South ")
        ('S', 'S', 'South')
    """
    if isinstance(value, tuple | list):
        codes = all(isinstance(each, int) and 0 <= each < 256 for each in value)
        value = bytes(value) if codes else "".join(map(as_text, value))
    if isinstance(value, bytes):
        value = value.decode("latin-1")
    if isinstance(value, int) and 0 < value < 128 and chr(value).isalpha():  # a letter's code
        value = chr(value)
    return "" if value is None else str(value).replace("\0", " ").strip()


def as_number(value: Any) -> float | None:
    """A finite number from a value of any type, the first of several; None if there is none.

    Example:
        >>> as_number(b"\\x06"), as_number((28,)), as_number("4.2 mm"), as_number("42/10"), as_number("none")
        (6.0, 28.0, 4.2, 4.2, None)
    """
    if isinstance(value, tuple | list):
        return as_number(value[0]) if value else None
    if isinstance(value, bytes) and len(value.strip(b"\0")) <= 1 and not value.strip(b"\0").isdigit():
        return float(max(value, default=0)) if value else None  # a BYTE, maybe padded
    try:
        if isinstance(value, bytes | str):
            found = NUMBER.match(as_text(value))
            number = float(found[1].replace(",", ".")) / float(found[2] or 1) if found else math.nan
        else:
            number = float(value)
    except (TypeError, ValueError, ArithmeticError):
        return None
    return number if math.isfinite(number) else None
