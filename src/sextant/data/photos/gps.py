"""Where a photo was taken, from EXIF, else XMP. Source: Exif 3.0, section 4.6.6, "GPS Attribute Information".

Cameras and programs write these tags in many types. As ExifTool reads them (its ``GPS.pm``), the first letter of a
reference counts, and values of one to three parts are degrees, minutes and seconds. Negative degrees are south or west,
whatever the reference. What is a guess (a missing reference; one that a sign contradicts) is used, and reported as a
doubt. Positions that cannot be right are left out, with the reason.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from PIL import Image

from sextant.data.metadata import GPS_BLOCK, NUMBER, as_number, as_text, directory, exif_of, xmp_of
from sextant.data.photos.reading import without_pillow_limit
from sextant.data.picture_files import open_picture

LATITUDE_REF, LATITUDE, LONGITUDE_REF, LONGITUDE, ALTITUDE_REF, ALTITUDE = range(1, 7)
DIRECTION_REF, DIRECTION = 16, 17
#: metres above sea level between which photos are taken: the deepest trench, and the edge of space
ALTITUDES = -11_000.0, 100_000.0
#: XMP's own names, and DJI's (one of which is misspelt)
IN_XMP = rb"gps%s\s*(?:=\s*[\"']|>)\s*([^\"'<]+)"


class _Axis(NamedTuple):
    tag: int
    reference: int
    name: str
    sides: tuple[str, str]  # positive and negative
    limit: float  # degrees


NORTHWARD = _Axis(LATITUDE, LATITUDE_REF, "latitude", ("north", "south"), 90)
EASTWARD = _Axis(LONGITUDE, LONGITUDE_REF, "longitude", ("east", "west"), 180)


class GpsPosition(NamedTuple):
    """A position on WGS 84.

    Attributes:
        latitude_deg: north of the equator.
        longitude_deg: east of Greenwich.
        altitude_m: above sea level; None if the block does not give it.
        direction_deg: viewing direction, clockwise from north, in [0, 360); None if the block does not give it.
        magnetic: whether that north is magnetic, which differs from true north by the local declination.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float | None
    direction_deg: float | None = None
    magnetic: bool = False


class PhotoGps(NamedTuple):
    """The position from a photo's metadata.

    Attributes:
        position: None if there is none, or it cannot be right.
        problem: what was assumed for a doubtful position, or why there is none; "" if nothing is wrong.
    """

    position: GpsPosition | None
    problem: str = ""


def photo_gps(path: Path) -> PhotoGps:
    """The position of a photo, of which only the header is read; none if it cannot be read."""
    try:
        with without_pillow_limit(), open_picture(path) as image:
            return gps_position(exif_of(image), xmp_of(image))
    except Exception:  # decoding the photo reports what is wrong with it
        return PhotoGps(None)


def gps_position(exif: Image.Exif, xmp: bytes = b"") -> PhotoGps:
    """The position from EXIF, or else from XMP; (0, 0), which cameras without a fix write, is none."""
    block = directory(exif, GPS_BLOCK)
    if LATITUDE not in block and LONGITUDE not in block:
        names = {LATITUDE: b"latitude", LONGITUDE: b"long(?:t)?itude"}
        found = {tag: re.search(IN_XMP % name, xmp, re.IGNORECASE) for tag, name in names.items()}
        block = {tag: match[1].decode("latin-1") for tag, match in found.items() if match} or block
    if LATITUDE not in block and LONGITUDE not in block:
        return PhotoGps(None)
    doubts: list[str] = []
    try:
        latitude, longitude = _degrees(block, NORTHWARD, doubts), _degrees(block, EASTWARD, doubts)
    except ValueError as error:
        return PhotoGps(None, str(error))
    if (latitude, longitude) == (0, 0):
        return PhotoGps(None, "its position is 0, 0, which cameras without a fix write")
    altitude, direction = as_number(block.get(ALTITUDE)), as_number(block.get(DIRECTION))
    if altitude is not None and _is_below(block.get(ALTITUDE_REF)):
        altitude = -abs(altitude)
    if altitude is not None and not ALTITUDES[0] <= altitude <= ALTITUDES[1]:
        doubts.append(f"its altitude of {altitude:,.0f} m is left out")
        altitude = None
    magnetic = direction is not None and as_text(block.get(DIRECTION_REF)).upper()[:1] == "M"
    heading = None if direction is None else direction % 360
    return PhotoGps(GpsPosition(latitude, longitude, altitude, heading, magnetic), "; ".join(doubts))


def _degrees(block: Mapping[int, Any], axis: _Axis, doubts: list[str]) -> float:
    """Signed degrees, with doubts about them; raises a ``ValueError`` with the reason if there are none."""
    name, sides = axis.name, axis.sides
    parts, given = _parts(block.get(axis.tag), as_text(block.get(axis.reference)))
    shown = " ".join("?" if part is None else f"{part:g}" for part in parts[:3])
    if not parts or parts[0] is None or (len(parts) > 1 and parts[1] is None):
        raise ValueError(f"its {name} {shown or 'is missing or'} cannot be read".replace("  ", " "))
    if len(parts) > 2 and parts[2] is None:
        doubts.append(f"the seconds of its {name} cannot be read: taken as 0")
    degrees, minutes, seconds = (*(abs(part or 0.0) for part in parts[:3]), 0.0, 0.0)[:3]
    if minutes > 60 or seconds > 60:
        raise ValueError(f"its {name} {shown} has more than 60 minutes or seconds")
    if (degrees % 1 and (minutes or seconds)) or (minutes % 1 and seconds):
        doubts.append(f"its {name} {shown} has fractions before smaller units: added up")
    size = degrees + minutes / 60 + seconds / 3600
    if size > axis.limit:
        raise ValueError(f"its {name} {shown} is beyond {axis.limit:g} degrees")
    signed = any(part is not None and math.copysign(1, part) < 0 for part in parts[:3])
    plus, minus = (given[:1].lower() == side[0] for side in sides)
    if signed and plus:
        doubts.append(f"its {name} {shown} is negative, its reference {given!r}: taken as {sides[1]}")
    elif not (signed or plus or minus or given == "+"):
        lacking = f"{given!r} as its reference" if given else "no reference"
        doubts.append(f"its {name} has {lacking}: taken as {sides[0]}")
    return -size if signed or minus else size


def _parts(value: Any, reference: str) -> tuple[list[float | None], str]:
    """Degrees, minutes and seconds, of which there may be fewer; and the reference, or else a text's letter or plus."""
    if isinstance(value, bytes | str):
        text = as_text(value)
        if not text.isprintable():
            return [None], reference
        if re.fullmatch(r"[+-]?\d+,\d{3,}", text):  # a decimal comma; else commas separate units, as in XMP
            text = text.replace(",", ".")
        letter = re.search(r"(?<![a-z])([nsew])(orth|outh|ast|est)?(?![a-z])", text, re.IGNORECASE)
        found = [as_number(match[0]) for match in NUMBER.finditer(text.replace(",", " "))]
        return found, reference or (letter[1] if letter else "+" if text.startswith("+") else "")
    values = list(value) if isinstance(value, tuple | list) else [] if value is None else [value]
    if len(values) == 6 and all(isinstance(each, int) for each in values):  # numerators and denominators
        values = [f"{over}/{under}" for over, under in zip(values[::2], values[1::2], strict=True)]
    return [as_number(each) for each in values], reference


def _is_below(reference: Any) -> bool:
    """Whether an altitude is below sea level or the ellipsoid: 1 or 3, as number or text, or in words."""
    text = as_text(reference)
    return as_number(reference) in (1, 3) or text[:1].lower() in ("b", "-") or text in ("\x01", "\x03")
