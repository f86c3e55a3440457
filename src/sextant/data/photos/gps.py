"""Where a photo was taken, from its EXIF block. Source: Exif 2.32, section 4.6.6, "GPS Attribute Information"."""

import math
from pathlib import Path
from typing import Any, NamedTuple

from PIL import Image

from sextant.data.photos.reading import known_formats, without_pillow_limit

GPS_BLOCK = 0x8825
LATITUDE_REF, LATITUDE, LONGITUDE_REF, LONGITUDE, ALTITUDE_REF, ALTITUDE = range(1, 7)
DIRECTION_REF, DIRECTION = 16, 17


class GpsPosition(NamedTuple):
    """A position on WGS 84.

    Attributes:
        latitude_deg: north of the equator.
        longitude_deg: east of Greenwich.
        altitude_m: above sea level; None if the block does not say.
        direction_deg: viewing direction, clockwise from north, in [0, 360); None if the block does not say.
        magnetic: whether that north is magnetic, which differs from true north by the local declination.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float | None
    direction_deg: float | None = None
    magnetic: bool = False


def photo_gps(path: Path) -> GpsPosition | None:
    """The position of a photo, of which only the header is read; also None if it cannot be read."""
    try:
        with without_pillow_limit(), Image.open(path, formats=known_formats()) as image:
            return gps_position(image.getexif())
    except Exception:  # decoding the photo reports what is wrong with it
        return None


def gps_position(exif: Image.Exif) -> GpsPosition | None:
    """The position, or None if it is missing, broken, not on Earth, or (0, 0), which cameras without a fix write."""
    try:
        block: dict[int, Any] = dict(exif.get_ifd(GPS_BLOCK))
        latitude = _degrees(block[LATITUDE], block.get(LATITUDE_REF), "S")
        longitude = _degrees(block[LONGITUDE], block.get(LONGITUDE_REF), "W")
    except Exception:  # metadata that cannot be read is no reason to refuse the photo
        return None
    if not (abs(latitude) <= 90 and abs(longitude) <= 180) or (latitude, longitude) == (0, 0):
        return None
    altitude, direction = _number(block, ALTITUDE), _number(block, DIRECTION)
    if altitude is not None and block.get(ALTITUDE_REF) in (1, b"\x01"):
        altitude = -altitude
    magnetic = direction is not None and _letter(block.get(DIRECTION_REF)) == "M"
    return GpsPosition(latitude, longitude, altitude, None if direction is None else direction % 360, magnetic)


def _degrees(value: Any, reference: Any, negative: str) -> float:
    degrees, minutes, seconds = (float(part) for part in value)
    size = degrees + minutes / 60 + seconds / 3600
    return -size if _letter(reference) == negative else size


def _letter(reference: Any) -> str:
    return str(reference).strip("\0 ").upper()


def _number(block: dict[int, Any], tag: int) -> float | None:
    """A finite number of the block, or None."""
    try:
        value = float(block[tag])
    except Exception:
        return None
    return value if math.isfinite(value) else None
