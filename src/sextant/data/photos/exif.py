r"""Focal length and direction of gravity from a photo's metadata.

With the 35-mm equivalent focal length :math:`f_{35}` of the EXIF block, which compares diagonals,
:math:`f = f_{35} \sqrt{W^2 + H^2} / \sqrt{36^2 + 24^2}` pixels. Source: CIPA DCG-001, "Guideline for noting
digital camera specifications in catalogs"; the tags are of Exif 2.32.
"""

import math
import struct
from collections.abc import Iterator
from fractions import Fraction
from typing import Literal, get_args

from PIL import Image

from sextant.data.metadata import EXIF_BLOCK, as_number, as_text, directory, exif_of, tag_of
from sextant.data.upright import STORED_FROM_UPRIGHT

FULL_FRAME_DIAGONAL = math.hypot(36, 24)
FOCAL_LENGTH, FOCAL_35MM = 0x920A, 0xA405
PLANE_X_RESOLUTION, PLANE_UNIT, PIXELS_X, PIXELS_Y = 0xA20E, 0xA210, 0xA002, 0xA003
MILLIMETRES = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}  # per unit of the focal plane resolution
#: sides of pictures in pixels, and of their ratio, beyond which a recorded size is rejected
LARGEST_SIDE, LARGEST_RATIO = 1e6, 30


def exif_numbers(image: Image.Image) -> dict[int, float]:
    """Finite positive numbers of the EXIF block, without those tags that are broken."""
    block = directory(exif_of(image), EXIF_BLOCK)
    tags = (FOCAL_LENGTH, FOCAL_35MM, PLANE_X_RESOLUTION, PLANE_UNIT, PIXELS_X, PIXELS_Y)
    numbers = {tag: as_number(block.get(tag)) for tag in tags}
    return {tag: number for tag, number in numbers.items() if number is not None and number > 0}


def exif_focal_px(exif: dict[int, float], width: int, height: int) -> float | None:
    """Focal length in pixels of a ``width`` x ``height`` picture from its EXIF numbers, or None.

    It is computed from the 35-mm equivalent, or else from the focal length and the resolution of the focal plane; a
    field of view that no lens has is skipped. It is also None if the block describes a different shape than the
    picture's (it was cropped since).
    """
    if was_cropped(exif, width, height):
        return None
    return next((focal for focal in _focals(exif, width, height) if 0.1 < focal / max(width, height) < 100), None)


def _focals(exif: dict[int, float], width: int, height: int) -> Iterator[float]:
    short, long = sorted((width, height))
    if FOCAL_35MM in exif:
        yield exif[FOCAL_35MM] * math.hypot(width, height) / FULL_FRAME_DIAGONAL
    if FOCAL_LENGTH in exif and PLANE_X_RESOLUTION in exif:
        per_millimetre = exif[PLANE_X_RESOLUTION] / MILLIMETRES.get(int(exif.get(PLANE_UNIT, 2)), 25.4)
        recorded = max(_recorded(exif)) or exif.get(PIXELS_X, 0) or exif.get(PIXELS_Y, 0) * long / short
        yield exif[FOCAL_LENGTH] * per_millimetre * long / (recorded or long)


def was_cropped(exif: dict[int, float], width: int, height: int) -> bool:
    """Whether the EXIF block describes a picture of a different shape than ``width`` x ``height``, upright or not.

    One recorded side alone describes no shape.
    """
    short, long = sorted(_recorded(exif))
    return short > 0 and abs(long / short / (max(width, height) / min(width, height)) - 1) > 0.02


def _recorded(exif: dict[int, float]) -> tuple[float, float]:
    """Both recorded sides in pixels; 0, 0 if one is missing or implausible."""
    sides = exif.get(PIXELS_X, 0.0), exif.get(PIXELS_Y, 0.0)
    believed = min(sides) >= 1 and max(sides) <= min(LARGEST_SIDE, LARGEST_RATIO * min(sides))
    return sides if believed else (0.0, 0.0)


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
    """The kind of metadata that gives the vertical; None if there is none or it is broken.

    Apple's maker note has the accelerometer's vector (tag 8 of its directory), Mapillary's app writes it into the image
    description, DJI writes the gimbal's pitch and Google the pose of a panorama into XMP, and Exif 2.32 has the
    camera's elevation angle. Sources: ExifTool's tables "Apple", "DJI" and "XMP-GPano"; Exif 2.32, tag 0x9405.

    Apple's vector :math:`a` is in g, in the axes of Core Motion: right, up and out of the screen, for the
    viewer; for a phone at rest it points down. The right side of the camera's sensor is at the phone's lower end, so
    that in the stored picture gravity is :math:`(-a_2, -a_1, -a_3)` to the right, down and forward.
    """
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
