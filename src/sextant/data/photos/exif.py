r"""What a photo's metadata says about its focal length.

With the 35-mm equivalent focal length :math:`f_{35}` of the EXIF block, which compares diagonals,
:math:`f = f_{35} \sqrt{W^2 + H^2} / \sqrt{36^2 + 24^2}` pixels. Source: CIPA DCG-001, "Guideline for noting
digital camera specifications in catalogs"; the tags are of Exif 2.32.
"""

import math
from collections.abc import Iterator

from PIL import Image

from sextant.data.metadata import EXIF_BLOCK, as_number, directory, exif_of

FULL_FRAME_DIAGONAL = math.hypot(36, 24)
FOCAL_LENGTH, FOCAL_35MM = 0x920A, 0xA405
PLANE_X_RESOLUTION, PLANE_UNIT, PIXELS_X, PIXELS_Y = 0xA20E, 0xA210, 0xA002, 0xA003
MILLIMETRES = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}  # per unit of the focal plane resolution
#: sides of pictures in pixels, and of their ratio, beyond which a recorded size is not believed
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
    field of view that no lens has is passed over. It is also None if the block describes a different shape than the
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
    """Both recorded sides in pixels; 0, 0 if one is missing or they are no picture's."""
    sides = exif.get(PIXELS_X, 0.0), exif.get(PIXELS_Y, 0.0)
    believed = min(sides) >= 1 and max(sides) <= min(LARGEST_SIDE, LARGEST_RATIO * min(sides))
    return sides if believed else (0.0, 0.0)
