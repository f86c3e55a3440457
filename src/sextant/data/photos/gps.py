"""Where a photo was taken, by its EXIF block. Source: Exif 2.32, section 4.6.6, "GPS Attribute Information"."""

import math
from typing import Any, NamedTuple

from PIL import Image

GPS_BLOCK = 0x8825
LATITUDE_REF, LATITUDE, LONGITUDE_REF, LONGITUDE, ALTITUDE_REF, ALTITUDE = range(1, 7)


class GpsPosition(NamedTuple):
    """A position on WGS 84.

    Attributes:
        latitude_deg: north of the equator.
        longitude_deg: east of Greenwich.
        altitude_m: above sea level, None where the block does not say.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float | None


def gps_position(exif: Image.Exif) -> GpsPosition | None:
    """The position, or None where there is none, it is broken or no place on Earth; (0, 0) is what cameras without a
    fix write.
    """
    try:
        block: dict[int, Any] = dict(exif.get_ifd(GPS_BLOCK))
        latitude = _degrees(block[LATITUDE], block.get(LATITUDE_REF), "S")
        longitude = _degrees(block[LONGITUDE], block.get(LONGITUDE_REF), "W")
    except Exception:  # metadata that cannot be read is no reason to refuse the photo
        return None
    if not (abs(latitude) <= 90 and abs(longitude) <= 180) or (latitude, longitude) == (0, 0):
        return None
    return GpsPosition(latitude, longitude, _altitude(block))


def _degrees(value: Any, reference: Any, negative: str) -> float:
    degrees, minutes, seconds = (float(part) for part in value)
    size = degrees + minutes / 60 + seconds / 3600
    return -size if str(reference).strip("\0 ").upper() == negative else size


def _altitude(block: dict[int, Any]) -> float | None:
    try:
        value = float(block[ALTITUDE])
    except Exception:
        return None
    below = block.get(ALTITUDE_REF) in (1, b"\x01")
    return None if not math.isfinite(value) else -value if below else value
