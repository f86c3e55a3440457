r"""Whether a photo's metadata tells the vertical, and gravity itself where a phone's accelerometer recorded it.

Apple's maker note has the accelerometer's vector (tag 8 of its directory), Mapillary's app writes it into the image
description, DJI writes the gimbal's pitch and Google the pose of a panorama into XMP, and Exif 2.32 has the camera's
elevation angle. Sources: ExifTool's tables "Apple", "DJI" and "XMP-GPano"; Exif 2.32, tag 0x9405.

Apple's vector :math:`a` is in g, in the axes of Core Motion: right, up and out of the screen, as seen by the viewer;
for a phone at rest it points down. The right side of the camera's sensor is at the phone's lower end, so that in the
stored picture gravity is :math:`(-a_2, -a_1, -a_3)` to the right, down and forward.
"""

import math
import struct
from fractions import Fraction
from typing import Literal, get_args

from PIL import Image

from sextant.data.metadata import EXIF_BLOCK, as_text, directory, tag_of
from sextant.data.upright import STORED_FROM_UPRIGHT

GravityTag = Literal[
    "accelerometer (Apple)", "accelerometer (Mapillary)", "gimbal", "panorama's pose", "elevation angle"
]
GRAVITY_TAGS: tuple[GravityTag, ...] = get_args(GravityTag)
DESCRIPTION, MAKER_NOTE, ELEVATION_ANGLE = 0x010E, 0x927C, 0x9405
APPLE, APPLE_ACCELERATION = b"Apple iOS\0", 0x0008
LENS_MODEL, SIGNED_FRACTION = 0xA434, 10
#: how far the accelerometer's reading may be from 1 g; beyond this, the phone was shaken
AT_REST = 0.1


def gravity_tag(exif: Image.Exif, xmp: bytes) -> GravityTag | None:
    """The metadata that tells the vertical; None if nothing does or the metadata is broken."""
    apple, mapillary, gimbal, panorama, elevation = GRAVITY_TAGS
    block = directory(exif, EXIF_BLOCK)
    note = block.get(MAKER_NOTE)
    if isinstance(note, bytes) and _apple_entry(note, APPLE_ACCELERATION):
        return apple
    if "MAPAccelerometerVector" in as_text(tag_of(exif, DESCRIPTION)):
        return mapillary
    if b"GimbalPitchDegree" in xmp:
        return gimbal
    if b"PosePitchDegrees" in xmp:
        return panorama
    return elevation if ELEVATION_ANGLE in block else None


def apple_gravity(exif: Image.Exif, width: int, height: int, orientation: int) -> tuple[float, float, float] | None:
    """Gravity from Apple's maker note: right, down, forward in the upright picture, of unit length.

    Args:
        exif: of the file.
        width, height: of the picture as stored, pixels.
        orientation: of the file by EXIF, 1 to 8.

    Returns:
        None if gravity is unknown: there is no such note, the phone was shaken, the camera is the front one, or the
        picture is stored upright, rotated by a program that may not have rotated the note with it.
    """
    try:
        block = directory(exif, EXIF_BLOCK)
        note = block.get(MAKER_NOTE)
        if not isinstance(note, bytes) or "front" in as_text(block.get(LENS_MODEL)).lower() or height > width:
            return None
        entry = _apple_entry(note, APPLE_ACCELERATION)
        if entry is None:
            return None
        kind, count, at = struct.unpack(">HII", entry)
        if (kind, count) != (SIGNED_FRACTION, 3):
            return None
        parts = struct.unpack_from(">6i", note, at)
        right, up, out = (float(Fraction(parts[i], parts[i + 1])) for i in (0, 2, 4))
    except Exception:  # metadata that cannot be read is no reason to refuse the photo
        return None
    size = math.hypot(right, up, out)
    if abs(size - 1) > AT_REST:
        return None
    (a, c), (b, d) = STORED_FROM_UPRIGHT[orientation]
    return (-a * up - b * right) / size, (-c * up - d * right) / size, -out / size


def _apple_entry(note: bytes, tag: int) -> bytes | None:
    """Type, count and value of a tag in the directory of an Apple maker note, which is big-endian from byte 14 on."""
    if not note.startswith(APPLE) or len(note) < 16:
        return None
    (count,) = struct.unpack_from(">H", note, 14)
    entries = (16 + 12 * k for k in range(count))
    found = (at for at in entries if at + 12 <= len(note) and struct.unpack_from(">H", note, at)[0] == tag)
    return next((note[at + 2 : at + 12] for at in found), None)
