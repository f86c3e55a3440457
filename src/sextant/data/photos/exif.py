r"""What a photo's metadata says about its focal length.

With the 35-mm equivalent focal length :math:`f_{35}` of the EXIF block, which compares diagonals,
:math:`f = f_{35} \sqrt{W^2 + H^2} / \sqrt{36^2 + 24^2}` pixels. Source: CIPA DCG-001, "Guideline for noting
digital camera specifications in catalogs"; the tags are of Exif 2.32.
"""

import math

from PIL import Image

FULL_FRAME_DIAGONAL = math.hypot(36, 24)
EXIF_BLOCK, FOCAL_LENGTH, FOCAL_35MM = 0x8769, 0x920A, 0xA405
PLANE_X_RESOLUTION, PLANE_UNIT, PIXELS_X, PIXELS_Y = 0xA20E, 0xA210, 0xA002, 0xA003
MILLIMETRES = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}  # per unit of the focal plane resolution


def exif_numbers(image: Image.Image) -> dict[int, float]:
    """Finite positive numbers of the EXIF block; empty if the block is broken."""
    found: dict[int, float] = {}
    try:
        block = image.getexif().get_ifd(EXIF_BLOCK)
        for tag in (FOCAL_LENGTH, FOCAL_35MM, PLANE_X_RESOLUTION, PLANE_UNIT, PIXELS_X, PIXELS_Y):
            value = float(block.get(tag, math.nan))
            if math.isfinite(value) and value > 0:
                found[tag] = value
    except Exception:  # metadata that cannot be read is no reason to refuse the photo
        return {}
    return found


def exif_focal_px(exif: dict[int, float], width: int, height: int) -> float | None:
    """Focal length in pixels of a ``width`` x ``height`` picture from its EXIF numbers, or None.

    It is computed from the 35-mm equivalent, or else from the focal length and the resolution of the focal plane. It is
    also None if the block describes a different shape than the picture's (it was cropped since), or a field of view
    that no lens has.
    """
    long = max(width, height)
    if was_cropped(exif, width, height):
        return None
    if FOCAL_35MM in exif:
        focal = exif[FOCAL_35MM] * math.hypot(width, height) / FULL_FRAME_DIAGONAL
    elif FOCAL_LENGTH in exif and PLANE_X_RESOLUTION in exif:
        per_millimetre = exif[PLANE_X_RESOLUTION] / MILLIMETRES.get(int(exif.get(PLANE_UNIT, 2)), 25.4)
        focal = exif[FOCAL_LENGTH] * per_millimetre * long / max(_recorded(exif, width, height))
    else:
        return None
    return focal if 0.1 < focal / long < 100 else None


def was_cropped(exif: dict[int, float], width: int, height: int) -> bool:
    """Whether the EXIF block describes a picture of a different shape than ``width`` x ``height``, upright or not."""
    short, long = sorted(_recorded(exif, width, height))
    return abs(long / short / (max(width, height) / min(width, height)) - 1) > 0.02


def _recorded(exif: dict[int, float], width: int, height: int) -> tuple[float, float]:
    return exif.get(PIXELS_X, max(width, height)), exif.get(PIXELS_Y, min(width, height))
