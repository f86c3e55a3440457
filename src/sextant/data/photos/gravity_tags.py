"""Whether a photo's metadata says which way is down.

Apple's maker note has the accelerometer's vector (tag 8 of its directory), Mapillary's app writes it into the image
description, DJI writes the gimbal's pitch and Google the pose of a panorama into XMP, and Exif 2.32 has the camera's
elevation angle. Sources: ExifTool's tables "Apple", "DJI" and "XMP-GPano"; Exif 2.32, tag 0x9405.
"""

import struct
from typing import Literal, get_args

from PIL import Image

from sextant.data.photos.exif import EXIF_BLOCK

GravityTag = Literal[
    "accelerometer (Apple)", "accelerometer (Mapillary)", "gimbal", "panorama's pose", "elevation angle"
]
GRAVITY_TAGS: tuple[GravityTag, ...] = get_args(GravityTag)
DESCRIPTION, MAKER_NOTE, ELEVATION_ANGLE = 0x010E, 0x927C, 0x9405
APPLE, APPLE_ACCELERATION = b"Apple iOS\0", 0x0008


def gravity_tag(exif: Image.Exif, xmp: bytes) -> GravityTag | None:
    """What of the metadata tells the vertical, None where nothing does or it is broken."""
    apple, mapillary, gimbal, panorama, elevation = GRAVITY_TAGS
    try:
        block = exif.get_ifd(EXIF_BLOCK)
        note, description = block.get(MAKER_NOTE), exif.get(DESCRIPTION)
    except Exception:  # metadata that cannot be read is no reason to refuse the photo
        block, note, description = {}, None, None
    if isinstance(note, bytes) and _has_apple_tag(note, APPLE_ACCELERATION):
        return apple
    if "MAPAccelerometerVector" in str(description):
        return mapillary
    if b"GimbalPitchDegree" in xmp:
        return gimbal
    if b"PosePitchDegrees" in xmp:
        return panorama
    return elevation if ELEVATION_ANGLE in block else None


def _has_apple_tag(note: bytes, tag: int) -> bool:
    """Whether the directory of an Apple maker note, big-endian from byte 14 on, has a tag."""
    if not note.startswith(APPLE) or len(note) < 16:
        return False
    (count,) = struct.unpack_from(">H", note, 14)
    entries = (16 + 12 * k for k in range(count))
    return any(at + 12 <= len(note) and struct.unpack_from(">H", note, at)[0] == tag for at in entries)
